"""The probe's silhouette over a red-lit board: a blunt cone, a black marking, then the barrel, from the upper left."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tests.vision.studio.board_canvas import Level, Points, coverage

ANGLE_DEG = 62.8
"""Way from the barrel to the tip, below the image's x axis (worked example of thesis 5.3: (306, 388) to (425, 620))."""
TAPER = 0.28
BARREL_PX = 42.0
LENGTH_PX = 900.0


@dataclass(frozen=True)
class Needle:
    """Pose and looks of the needle; the tip is the middle of its blunt end."""

    tip_px: tuple[float, float]
    angle_deg: float
    end_px: float
    metal: float
    streak: float
    streak_at: float
    mark_px: tuple[float, float]
    """Where the black marking begins and ends, along the axis from the tip."""

    def along_across(self, points_px: Points) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Return each point's distance from the tip up the axis, and from the axis."""
        angle = np.deg2rad(self.angle_deg)
        dx, dy = points_px[..., 0] - self.tip_px[0], points_px[..., 1] - self.tip_px[1]
        return -dx * np.cos(angle) - dy * np.sin(angle), dx * np.sin(angle) - dy * np.cos(angle)

    def half_width(self, along: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return np.minimum(self.end_px + TAPER * np.maximum(along, 0.0), BARREL_PX) / 2

    def covers(self, points_px: Points) -> npt.NDArray[np.bool_]:
        """Tell which points (..., 2) the needle hides."""
        along, across = self.along_across(points_px)
        return (along >= 0) & (np.abs(across) <= self.half_width(along))

    def outline(self) -> Points:
        """Return the silhouette (N, 2) in px, far end outside the frame."""
        along = np.array([0.0, (BARREL_PX - self.end_px) / TAPER, LENGTH_PX])
        half = self.half_width(along)
        s, t = np.concatenate((along, along[::-1])), np.concatenate((half, -half[::-1]))
        angle = np.deg2rad(self.angle_deg)
        x = self.tip_px[0] - s * np.cos(angle) + t * np.sin(angle)
        y = self.tip_px[1] - s * np.sin(angle) - t * np.cos(angle)
        return np.column_stack((x, y))


def random_needle(rng: np.random.Generator, tip_px: tuple[float, float]) -> Needle:
    start = rng.uniform(122, 136)
    return Needle(
        tip_px=tip_px,
        angle_deg=ANGLE_DEG + rng.uniform(-3, 3),
        end_px=rng.uniform(3, 6),
        metal=rng.uniform(40, 90),
        streak=rng.uniform(40, 120),
        streak_at=rng.uniform(-0.4, 0.4),
        mark_px=(start, start + rng.uniform(55, 80)),
    )


def draw_needle(frame: Level, needle: Needle) -> None:
    """Lay the needle over the frame (H, W), in place."""
    share, x0, y0 = coverage(needle.outline(), (frame.shape[0], frame.shape[1]))
    height, width = share.shape
    under = frame[y0 : y0 + height, x0 : x0 + width]
    y, x = np.mgrid[y0 : y0 + height, x0 : x0 + width]
    along, across = needle.along_across(np.dstack((x, y)).astype(np.float64))
    side = across / needle.half_width(along)
    level = needle.metal * (1.0 - 0.35 * side**2) + needle.streak * np.exp(-(((side - needle.streak_at) / 0.18) ** 2))
    level = np.where((along > needle.mark_px[0]) & (along < needle.mark_px[1]), 12.0, level).astype(np.float32)
    under += share * (level - under)
