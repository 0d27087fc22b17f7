"""How far a homing run has gone: a run that leaves its switch behind must end. Pure: time is an argument."""

from typing import Final

from drivers.errors import MotionError
from drivers.l4118.contract import AxisConfig

# The switches lie somewhat outside of the range that is used
_RANGES: Final = 1.2
# What the axis may be thought to have gone between two looks; a greater step is the new zero of the count
_STEPS: Final = 3.0


class TravelWatch:
    """Adds up the way of one homing run from look to look; a step that no motor makes is the count's new zero."""

    def __init__(self, config: AxisConfig, position_units: float, now_s: float) -> None:
        self._config = config
        self._last_units, self._last_s = position_units, now_s
        self._at_units = self._low_units = self._high_units = 0.0

    def look(self, position_units: float, now_s: float) -> None:
        """Take one look; raise MotionError once the run went farther than the axis is long."""
        step, span_s = position_units - self._last_units, now_s - self._last_s
        self._last_units, self._last_s = position_units, now_s
        config = self._config
        fastest = max(config.homing.switch_speed_units_s, config.homing.zero_speed_units_s)
        if abs(step) > _STEPS * fastest * (span_s + config.poll_s) + config.window_units:
            return
        self._at_units += step
        self._low_units = min(self._low_units, self._at_units)
        self._high_units = max(self._high_units, self._at_units)
        way = self._high_units - self._low_units
        if way > _RANGES * (config.max_units - config.min_units):
            text = f"homing (method {config.homing.method}) went {way:.1f} and met no switch: the axis is not that long"
            advice = "Check the switch and its wire, and that switch_inputs of this axis lets the drive heed it."
            raise MotionError(text, device=config.name, advice=advice)
