"""From the light a scene returns to the frame a camera delivers: optics, lamp and sensor.

The chain is that of a real camera, in its order: the lamp lights the scene unevenly, the lens blurs what comes back,
the sensor clips, adds noise and has a few dead or hot pixels.
"""

from typing import Literal

import cv2
import numpy as np
import numpy.typing as npt

Level = npt.NDArray[np.float32]
Frame = npt.NDArray[np.uint8]
Colour = Literal["white", "red"]

BGR_GAIN: dict[Colour, tuple[float, float, float]] = {"white": (0.97, 1.0, 1.02), "red": (0.10, 0.16, 1.0)}
"""What each channel sees of one grey level under the two lamps; white has the slight warmth of a lamp."""

CHANNEL_NOISE = 0.35
"""Share of the noise that is independent in the channels; the rest is common, as a demosaicked sensor has it."""


def develop(
    level: Level,
    *,
    gain: float,
    blur_px: float,
    noise: float,
    spikes: float,
    rng: np.random.Generator,
    falloff: float = 0.0,
    lamp_px: tuple[float, float] | None = None,
    offset: float = 0.0,
    colour: Colour = "white",
) -> Frame:
    """Return the frame (H, W, 3), BGR, of a scene given as reflected light (H, W) in grey levels (255: a white sheet).

    ``gain`` scales the light and ``offset`` (grey levels) is stray light added to it. ``blur_px`` and ``noise`` are the
    standard deviations of the lens (px) and of the sensor (grey levels). ``spikes`` is the share of pixels that are
    black or white. ``falloff`` is the share of light lost at the frame's corner farthest from ``lamp_px`` (default:
    the middle of the frame).
    """
    if level.ndim != 2 or level.dtype != np.float32:
        msg = f"level must be float32 of shape (H, W), got {level.dtype} {level.shape}"
        raise ValueError(msg)
    light: Level = level * _lamp(level.shape, falloff, lamp_px) if falloff > 0 else level
    light = light * np.float32(gain) + np.float32(offset)
    if blur_px > 0:
        light = np.asarray(cv2.GaussianBlur(light, (0, 0), blur_px, borderType=cv2.BORDER_REPLICATE), np.float32)
    frame = _expose(light, noise, BGR_GAIN[colour], rng)
    if spikes > 0:
        _spike(frame, spikes, rng)
    return frame


def _lamp(shape: tuple[int, ...], falloff: float, lamp_px: tuple[float, float] | None) -> Level:
    height, width = shape
    x0, y0 = lamp_px if lamp_px is not None else ((width - 1) / 2, (height - 1) / 2)
    dx2 = (np.arange(width, dtype=np.float32) - np.float32(x0)) ** 2
    dy2 = (np.arange(height, dtype=np.float32) - np.float32(y0)) ** 2
    far2 = max(float(dx2[i] + dy2[j]) for i in (0, -1) for j in (0, -1))
    return np.float32(1.0) - np.float32(falloff / max(far2, 1.0)) * (dy2[:, None] + dx2[None, :])


def _expose(light: Level, noise: float, bgr_gain: tuple[float, float, float], rng: np.random.Generator) -> Frame:
    frame = np.empty((*light.shape, 3), np.uint8)
    common = noise * float(np.sqrt(1.0 - CHANNEL_NOISE))
    own = noise * float(np.sqrt(CHANNEL_NOISE))
    shared = rng.standard_normal(light.shape, dtype=np.float32) * np.float32(common) if noise > 0 else None
    for channel, channel_gain in enumerate(bgr_gain):
        seen = light * np.float32(channel_gain)
        if shared is not None:
            seen += shared
            seen += rng.standard_normal(light.shape, dtype=np.float32) * np.float32(own)
        np.clip(seen, 0.0, 255.0, out=seen)
        frame[..., channel] = np.rint(seen)
    return frame


def _spike(frame: Frame, share: float, rng: np.random.Generator) -> None:
    height, width = frame.shape[:2]
    count = int(rng.binomial(height * width, share))
    where = (rng.integers(0, height, count), rng.integers(0, width, count))
    frame[where] = rng.choice(np.array([0, 255], np.uint8), count)[:, None]


def delivered(frame: Frame, rng: np.random.Generator) -> Frame:
    """Return the frame as a colour camera sends it: sampled through a Bayer mosaic, interpolated, packed as JPEG."""
    mosaic = frame[..., 1].copy()
    mosaic[0::2, 0::2] = frame[0::2, 0::2, 2]
    mosaic[1::2, 1::2] = frame[1::2, 1::2, 0]
    colour = cv2.cvtColor(mosaic, cv2.COLOR_BayerRGGB2BGR)
    _, packed = cv2.imencode(".jpg", colour, [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(82, 97))])
    return np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR), dtype=np.uint8)
