"""Camera controls as a UVC driver shows them, and what its automatics do to the image.

At power-up the automatics are on, as in any web camera: images then change after each switch of the light until
somebody turns them off. A manual value set while its automatic is on is kept and takes effect afterwards.
"""

import math
from dataclasses import dataclass

from sim_hw.scene.optics import Head
from sim_hw.scene.sensor import NOMINAL_EXPOSURE_S, Channels

_GAIN_DOUBLES_AT = 64
"""Control units above zero that double the signal."""
_BEST_FOCUS = 120
_BLUR_PX_PER_FOCUS = 0.02
_NEUTRAL_K = 4600
_AUTO_STEP = 0.35
"""Share of the way to its goal that an automatic goes in a frame."""
_AUTO_LONGEST_S = 0.060
_DARK = 0.02
"""Light the automatic exposure believes in at least."""


@dataclass(frozen=True)
class Control:
    """The range of one control."""

    minimum: int
    maximum: int
    step: int
    default: int

    def clamp(self, value: float) -> int:
        """Return the nearest value the control can take."""
        inside = min(max(value, self.minimum), self.maximum)
        steps = round((inside - self.minimum) / self.step)
        return min(self.minimum + steps * self.step, self.maximum)


CONTROLS: dict[str, Control] = {
    "exposure_us": Control(100, 100_000, 100, 20_000),
    "gain": Control(0, 255, 1, 0),
    "focus": Control(0, 250, 5, _BEST_FOCUS),
    "white_balance_k": Control(2800, 6500, 10, _NEUTRAL_K),
    "auto_exposure": Control(0, 1, 1, 1),
    "auto_white_balance": Control(0, 1, 1, 1),
    "auto_focus": Control(0, 1, 1, 1),
}


@dataclass(frozen=True)
class Taken:
    """How one frame is taken."""

    exposure_s: float
    gain: float
    balance: Channels
    focus_px: float


class Controls:
    """Hold the values and run the automatics, one step a frame."""

    def __init__(self) -> None:
        self.values = {name: control.default for name, control in CONTROLS.items()}
        self._auto_exposure_s = NOMINAL_EXPOSURE_S
        self._auto_warmth = 0.0

    def set(self, name: str, value: float) -> int:
        """Set a control and return the value it really took.

        Raises:
            KeyError: the camera has no such control.

        """
        self.values[name] = CONTROLS[name].clamp(value)
        return self.values[name]

    def listing(self) -> dict[str, dict[str, int]]:
        """Return value and range of every control."""
        return {
            name: {
                "value": self.values[name],
                "minimum": control.minimum,
                "maximum": control.maximum,
                "step": control.step,
            }
            for name, control in CONTROLS.items()
        }

    def expose(self, state: Head) -> Taken:
        """Return how the frame that begins now is taken, and let the automatics see its light."""
        self._adapt(state)
        exposure_s = self.values["exposure_us"] / 1e6
        if self.values["auto_exposure"]:
            exposure_s = self._auto_exposure_s
        focus = self.values["focus"] if not self.values["auto_focus"] else _BEST_FOCUS - 20
        return Taken(
            exposure_s=exposure_s,
            gain=1.0 + self.values["gain"] / _GAIN_DOUBLES_AT,
            balance=self._balance(),
            focus_px=_BLUR_PX_PER_FOCUS * abs(focus - _BEST_FOCUS),
        )

    def _balance(self) -> Channels:
        warmth = math.log(_NEUTRAL_K / self.values["white_balance_k"])
        if self.values["auto_white_balance"]:
            warmth = self._auto_warmth
        # A low colour temperature tells the camera that the light is reddish: it lifts blue and lowers red.
        return (round(math.exp(0.6 * warmth), 3), 1.0, round(math.exp(-0.6 * warmth), 3))

    def _adapt(self, state: Head) -> None:
        light = max(_DARK, state.white + 0.8 * state.red)
        goal_s = min(max(NOMINAL_EXPOSURE_S / light, 1e-4), _AUTO_LONGEST_S)
        self._auto_exposure_s = round(self._auto_exposure_s * (goal_s / self._auto_exposure_s) ** _AUTO_STEP, 6)
        reddish = 0.4 if state.red > state.white else 0.0
        self._auto_warmth += _AUTO_STEP * (reddish - self._auto_warmth)
