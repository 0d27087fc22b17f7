"""Lens and sensor: blur, fall-off, exposure, white balance, noise, clipping."""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from sim_hw.scene.optics import HEIGHT_PX, WIDTH_PX

Image = npt.NDArray[np.uint8]
Channels = tuple[float, float, float]

NOMINAL_EXPOSURE_S = 0.020
BLACK_LEVEL = 3.0
RED_SEEN = (0.03, 0.05, 1.0)
"""How much of the red lamp's light the blue, green and red pixels see."""
AMBIENT = 0.004
"""The room: a little white light even when both lamps are off, as a share of the white lamp."""
_LAMP_CENTRE_PX = (760.0, 585.0)
_SPARE_PX = 192
"""How much larger than a frame the noise is: it is cut out at random offsets."""


@dataclass(frozen=True)
class Exposed:
    """Light that reached the lens during one exposure.

    `white` (H, W, 3) and `red` (H, W) are reflectances as uint8 at full lamp; either is None where its lamp gave
    next to nothing. The levels are the lamps' mean levels 0..1 over the exposure.
    """

    white: Image | None
    white_level: float
    red: Image | None
    red_level: float


@dataclass(frozen=True)
class SensorSettings:
    """How the sensor turns light into grey levels."""

    exposure_s: float
    gain: float = 1.0
    balance: Channels = (1.0, 1.0, 1.0)  # blue, green, red
    blur_px: float = 1.0
    noise_grey: float = 3.0
    falloff: float = 0.15


class Sensor:
    """Apply the sensor; what can be prepared is kept between frames. Not to be used by two threads at once.

    Everything stays in saturating 8-bit arithmetic, which is several times faster than wider types; a saturated
    place therefore keeps the lower half of its noise.
    """

    def __init__(self, seed: int) -> None:
        self._seed = seed
        empty: Image = np.zeros((0, 0, 3), dtype=np.uint8)
        self._noise_up, self._noise_down = empty, empty
        self._noise_grey = -1.0
        self._fall = {"white": empty, "red": empty}
        self._fall_key: tuple[float, Channels] | None = None

    def read(self, light: Exposed, settings: SensorSettings, rng: np.random.Generator) -> Image:
        """Return the frame (H, W, 3) BGR uint8."""
        self.prepare(settings)
        strength = settings.exposure_s / NOMINAL_EXPOSURE_S * settings.gain * max(settings.balance) / 255.0
        frame: Image = np.zeros((HEIGHT_PX, WIDTH_PX, 3), dtype=np.uint8)
        if light.white is not None:
            image = blurred(light.white, settings.blur_px)
            level = light.white_level + AMBIENT
            cv2.multiply(image, self._fall["white"], dst=frame, scale=level * strength)
        if light.red is not None:
            plane = blurred(light.red, settings.blur_px)
            image = np.asarray(cv2.merge([plane, plane, plane]), dtype=np.uint8)
            lit = cv2.multiply(image, self._fall["red"], scale=light.red_level * strength)
            cv2.add(frame, lit, dst=frame)
        y, x = (int(value) for value in rng.integers(0, _SPARE_PX, 2))
        cut = np.s_[y : y + HEIGHT_PX, x : x + WIDTH_PX]
        cv2.add(frame, self._noise_up[cut], dst=frame)
        cv2.subtract(frame, self._noise_down[cut], dst=frame)
        return frame

    def prepare(self, settings: SensorSettings) -> None:
        """Make what is kept between frames taken with these settings."""
        if settings.noise_grey != self._noise_grey:
            rng = np.random.default_rng((self._seed, 3))
            size = (HEIGHT_PX + _SPARE_PX, WIDTH_PX + _SPARE_PX, 3)
            grains = np.round(rng.standard_normal(size, dtype=np.float32) * settings.noise_grey + BLACK_LEVEL)
            self._noise_up = np.clip(grains, 0, 255).astype(np.uint8)
            self._noise_down = np.clip(-grains, 0, 255).astype(np.uint8)
            self._noise_grey = settings.noise_grey
        key = (settings.falloff, settings.balance)
        if key != self._fall_key:
            rows, columns = np.mgrid[0:HEIGHT_PX, 0:WIDTH_PX].astype(np.float32)
            away = (columns - _LAMP_CENTRE_PX[0]) ** 2 + (rows - _LAMP_CENTRE_PX[1]) ** 2
            fall = np.clip(255.0 * (1.0 - settings.falloff * away / 1000.0**2), 0.0, 255.0)
            for light, seen in (("white", (1.0, 1.0, 1.0)), ("red", RED_SEEN)):
                shares = np.array(seen) * settings.balance / max(settings.balance)
                self._fall[light] = np.round(fall[..., None] * shares).astype(np.uint8)
            self._fall_key = key


def blurred(image: Image, sigma_px: float) -> Image:
    """Return the image behind a lens that spreads a point over `sigma_px`."""
    if sigma_px < 0.2:
        return image
    reach = max(1, round(2.2 * sigma_px))
    size = 2 * reach + 1
    return np.asarray(cv2.GaussianBlur(image, (size, size), sigma_px), dtype=np.uint8)
