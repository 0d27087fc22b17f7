"""Image input: checks, reduction to one channel, cleaning.

Every array is (H, W) or (H, W, 3), row first; x runs right, y runs down, pixel centres lie at integers.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.core.not_found import NotFound, Reason

Gray = NDArray[np.uint8]
Bgr = NDArray[np.uint8]
Plane = NDArray[np.float32]

HIGHLIGHT_KERNEL = np.array([[-1, -1, -1], [-1, 10, -1], [-1, -1, -1]], dtype=np.float32) / 2.0
"""Fig. 5.8 of the thesis: brightens bright detail and darkens dark detail; its weights sum to 2, by which it is
divided."""
SPIKE_LEVELS = 60
"""A pixel this far from the median of its 3x3 neighbourhood is salt or pepper: the optics blur any real detail
wider."""
SATURATED_LEVEL = 250
"""At this level or above an 8-bit pixel carries no more information."""


def check_bgr(image: Any) -> Bgr:
    """Return `image` if it is (H, W, 3) uint8 with at least one pixel, else raise ValueError saying what it is."""
    if not isinstance(image, np.ndarray):
        # One error type for every unusable image: callers catch ValueError.
        raise ValueError(  # noqa: TRY004 -- see above
            f"expected a numpy array (H, W, 3) of uint8 in BGR order, got {type(image).__name__}"
        )
    if image.dtype != np.uint8:
        raise ValueError(f"expected uint8 pixels, got {image.dtype}; convert to 0..255 first")
    if image.ndim != 3 or image.shape[2] != 3:
        raise ValueError(f"expected shape (H, W, 3), got {image.shape}; a gray picture needs three equal channels")
    if image.shape[0] == 0 or image.shape[1] == 0:
        raise ValueError(f"expected a picture with pixels, got shape {image.shape}")
    return image


def check_point(point_px: Any, name: str) -> tuple[float, float]:
    """Return `point_px` as two finite floats (x, y) in px, else raise ValueError naming the argument."""
    try:
        x_px, y_px = (float(part) for part in point_px)
    except (TypeError, ValueError) as exc:
        raise ValueError(f"{name} must be two numbers (x, y) in px, got {point_px!r}") from exc
    if not (np.isfinite(x_px) and np.isfinite(y_px)):
        raise ValueError(f"{name} must be finite, got ({x_px}, {y_px})")
    return x_px, y_px


def gray(bgr: Bgr) -> Gray:
    """Return the luma (Rec. 601) of a BGR image, shape (H, W) uint8. Used for white images."""
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY), dtype=np.uint8)


def intensity(bgr: Bgr) -> Gray:
    """Return the I of HSI, (R + G + B) / 3, shape (H, W) uint8 (thesis 5.4.2 step 2)."""
    return np.asarray(cv2.transform(bgr, np.full((1, 3), 1.0 / 3.0, dtype=np.float32)), dtype=np.uint8)


def red_signal(bgr: Bgr) -> Gray:
    """Return the channel that carries a red-lit image, shape (H, W) uint8.

    Under red light blue and green hold no light, so I is R/3 in 85 steps with three channels' noise: the red channel
    alone has the same image at three times the contrast and about 1.7 times the signal to noise. When red does not
    lead (a gray image, a lamp of another colour) I is the better signal and is returned.
    """
    # Which colour leads shows in every eighth row as well.
    few = np.ascontiguousarray(bgr[::8])
    blue, green, red = (float(level) for level in cv2.mean(few)[:3])
    if red >= 1.5 * max(blue, green):
        return np.asarray(cv2.extractChannel(bgr, 2), dtype=np.uint8)
    return intensity(bgr)


def median(plane: Gray, size_px: int) -> Gray:
    """Return the median over size_px x size_px (odd) windows (thesis eq. 5.1)."""
    return np.asarray(cv2.medianBlur(plane, size_px), dtype=np.uint8)


def despike(plane: Gray) -> Gray:
    """Replace salt and pepper by the 3x3 median and leave every other pixel as it was.

    A plain median moves the rims of small circles; this one touches only pixels that no lens can have drawn, so
    sub-pixel positions measured afterwards are not shifted.
    """
    smooth = cv2.medianBlur(plane, 3)
    return np.asarray(np.where(cv2.absdiff(plane, smooth) > SPIKE_LEVELS, smooth, plane), dtype=np.uint8)


def highlight(plane: Gray) -> Gray:
    """Convolve with [-1 .. 10 .. -1] / 2, clipped to 0..255 (thesis fig. 5.8: bright and dark detail stand out)."""
    return np.asarray(cv2.filter2D(plane, cv2.CV_8U, HIGHLIGHT_KERNEL), dtype=np.uint8)


def check_exposure(plane: Gray, dark_level: float, dark_percentile: float, clipped_share: float) -> NotFound | None:
    """Return why the light in `plane` cannot be worked with, or None.

    Too dark: even the `dark_percentile` brightest pixel stays below `dark_level`. Saturated: more than
    `clipped_share` (0..1) of the pixels are at the top of the scale.
    """
    few = plane[::3, ::3]
    bright = float(np.partition(few.ravel(), rank := int(dark_percentile / 100.0 * (few.size - 1)))[rank])
    if bright < dark_level:
        return NotFound(
            Reason.TOO_DARK,
            f"the bright parts reach only {bright:.0f} of 255 (at least {dark_level:.0f} is needed): "
            "is the lamp on, and the exposure as it was at calibration?",
        )
    clipped = float(np.mean(few >= SATURATED_LEVEL))
    if clipped > clipped_share:
        return NotFound(
            Reason.SATURATED,
            f"{100 * clipped:.0f} % of the pixels are at full scale (at most {100 * clipped_share:.0f} % may be): "
            "shorten the exposure or look for a second light.",
        )
    return None
