"""When a set-point is taken, when its move is over, and when it never will be. Pure: time is an argument."""

import math

from drivers.errors import LimitHit, MotionError, Stalled
from drivers.l4118.contract import AxisConfig, AxisStatus


def travel_s(distance: float, speed: float, acceleration: float) -> float:
    """Give how long a way takes from rest to rest: two ramps, and what is left at full speed (trapezoid)."""
    distance = abs(distance)
    if distance * acceleration < speed * speed:
        return 2.0 * math.sqrt(distance / acceleration)
    return distance / speed + speed / acceleration


def seen_to_go(config: AxisConfig, here: AxisStatus, target_units: float) -> bool:
    """Tell whether an axis that goes from here to a target is seen to have gone: it is farther than both windows."""
    return abs(target_units - here.position_units) > 2 * config.window_units


class TakenWatch:
    """Judges whether a drive has taken a set-point: by bit 12, which may still be that of the one before."""

    def __init__(self, config: AxisConfig, before: AxisStatus, *, old_stands: bool) -> None:
        """Take the look before it, and whether bit 12 of the one before was not seen to be gone since."""
        self._window_units, self._before, self._old_stands = config.window_units, before, old_stands

    def taken(self, status: AxisStatus) -> bool:
        """Tell it by a look: an old bit 12 says nothing until the old bit 10 fell, or the axis has left its place."""
        if not status.acknowledged or not self._old_stands:
            return status.acknowledged
        gone_units = abs(status.position_units - self._before.position_units)
        return gone_units > self._window_units or (self._before.target_reached and not status.target_reached)


class ArrivalWatch:
    """Judges the looks at one axis between the acknowledged set-point and the end of the move."""

    def __init__(self, config: AxisConfig, start_units: float, target_units: float, now_s: float) -> None:
        self._config = config
        self._target_units = target_units
        # In the motor's sense: the limit switches are the motor's
        self._sense = (target_units - start_units) * config.increments_per_unit
        self._last_units = start_units
        self._moved_at_s = now_s

    def taken(self, now_s: float) -> None:
        """Count a standstill from here: the drive has taken the set-point only now."""
        self._moved_at_s = now_s

    def arrived(self, status: AxisStatus, now_s: float) -> bool:
        """Tell whether the axis stands on its target; raise LimitHit or Stalled when it cannot get there."""
        config = self._config
        error_units = status.position_units - self._target_units
        inside = abs(error_units) <= config.window_units
        if status.target_reached and inside:
            return True
        if status.mode_error:
            raise Stalled("following error: the axis does not follow", device=config.name)
        if not inside:
            self._check_limits(status)
        if abs(status.position_units - self._last_units) > config.window_units / 2:
            self._last_units, self._moved_at_s = status.position_units, now_s
        elif now_s - self._moved_at_s > config.stall_s:
            raise self._stuck(status, error_units)
        return False

    def _check_limits(self, status: AxisStatus) -> None:
        where = f"at {status.position_units:.3f}, on the way to {self._target_units:.3f}"
        if self._sense < 0 and status.negative_limit:
            raise LimitHit(f"negative limit switch {where}", device=self._config.name)
        if self._sense > 0 and status.positive_limit:
            raise LimitHit(f"positive limit switch {where}", device=self._config.name)

    def _stuck(self, status: AxisStatus, error_units: float) -> MotionError:
        where = f"stands at {status.position_units:.3f}, {abs(error_units):.3f} short of {self._target_units:.3f}"
        if status.limit_exceeded:
            return LimitHit(f"{where}: the drive reports an internal limit", device=self._config.name)
        return Stalled(where, device=self._config.name)
