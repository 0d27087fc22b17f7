"""Search window: the part of a red image round the tip, and what of it something may stand in front of."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.core import Gray, Plane, View, despike, median, quantile

Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Window:
    """Hold the part of the red image that is looked at, each image (H, W).

    clean: uint8, spikes removed, else as taken; raw: the same as float32; smooth: median-filtered, for shapes only.
    hidden: what the probe covers. maybe_hidden: where a probe of which nothing is known may stand (all false when the
    probe is known). x_px, y_px: pixel (0, 0) in the image; board_level: brightness of the bare board; around_px: the
    tip, in the window's pixels; reach_px: how far from it pads are looked for;
    hole_radius_px: the holes CAD knows of in the pads looked for, 0 for none, None when it is not known.
    """

    clean: Gray
    raw: Plane
    smooth: Gray
    hidden: Flags
    maybe_hidden: Flags
    x_px: int
    y_px: int
    board_level: float
    around_px: tuple[float, float]
    reach_px: float
    view: View
    hole_radius_px: float | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width in px."""
        return self.clean.shape[0], self.clean.shape[1]

    def distance_px(self, x_px: float, y_px: float) -> float:
        """Return how far a point of the window lies from the tip."""
        return float(np.hypot(x_px - self.around_px[0], y_px - self.around_px[1]))


def open_window(
    plane: Gray,
    corner: tuple[int, int],
    around_px: tuple[float, float],
    reach_px: float,
    view: View,
    hole_radius_px: float | None = None,
) -> Window:
    """Prepare a window (H, W) uint8 whose top-left pixel is `corner`, nothing in it hidden."""
    clean = despike(np.ascontiguousarray(plane))
    smooth = median(clean, 3)
    around = around_px[0] - corner[0], around_px[1] - corner[1]
    nothing = np.zeros(clean.shape, dtype=np.bool_)
    board = quantile(smooth, 0.25)
    return Window(
        clean=clean,
        raw=clean.astype(np.float32),
        smooth=smooth,
        hidden=nothing,
        maybe_hidden=nothing,
        x_px=corner[0],
        y_px=corner[1],
        board_level=board,
        around_px=around,
        reach_px=reach_px,
        view=view,
        hole_radius_px=hole_radius_px,
    )


def hide(window: Window, outline: NDArray[np.float64], *, certain: bool) -> Window:
    """Return the window with a probe's outline (N, 2), in the window's pixels, hidden, or maybe so."""
    cover = np.zeros(window.shape, dtype=np.uint8)
    cv2.fillPoly(cover, [np.rint(outline * 16.0).astype(np.int32)], (1,), shift=4)
    covered = cover > 0
    if not certain:
        return replace(window, maybe_hidden=covered)
    seen = window.smooth[~covered]
    return replace(window, hidden=covered, board_level=quantile(seen, 0.25) if seen.size else 0.0)
