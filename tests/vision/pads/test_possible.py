"""A via whose trace shows in the same opening of the mask: taken, or at least possible, and never its trace's end."""

import numpy as np

from tests.vision.scene import AXIS_DEG, NOMINAL_TIP, Camera, Canvas, frame_of
from vision import Seen, View, find_test_points

RADIUS_PX, TRACE_PX, OPENING_PX = 6.3, 8.3, 14.0
HOLE_PX, TIGHT_PX = 2.2, 12.0
VIEW = View(minor_rad=float(np.radians(AXIS_DEG)))


def _look(
    towards_deg: float, seed: int, hole_px: float = 0.0, opening_px: float = OPENING_PX
) -> tuple[Seen, tuple[float, float]]:
    """Draw the via with its trace towards one side, up to the opening's rim; return what is seen and its centre."""
    rng = np.random.default_rng(seed)
    canvas = Canvas(NOMINAL_TIP, (80, 80), 35.0)
    x, y = np.add(NOMINAL_TIP, rng.uniform(-3.0, 3.0, 2))
    canvas.paint(canvas.ellipse(x, y, RADIUS_PX, 0.87, AXIS_DEG), 190.0)
    half = opening_px / 2 * np.array([np.cos(np.radians(towards_deg)), np.sin(np.radians(towards_deg))])
    canvas.paint(canvas.bar((x + half[0], y + half[1]), towards_deg, opening_px, TRACE_PX), 190.0)
    if hole_px:
        canvas.paint(canvas.ellipse(x, y, hole_px, 0.87, AXIS_DEG), 30.0)
    frame = frame_of(canvas.develop(Camera(noise=3.0), rng), canvas, False, 35.0)
    return find_test_points(frame, NOMINAL_TIP, 30, 6.25, view=VIEW), (x, y)


def test_in_every_direction_the_via_is_taken_or_possible_and_its_trace_never() -> None:
    only_possible = 0
    for k, towards_deg in enumerate(range(0, 360, 10)):
        seen, centre = _look(towards_deg, k)
        possible = seen.possible(6.25)
        off = [np.hypot(p.x_px - centre[0], p.y_px - centre[1]) for p in (*seen.taken, *possible)]
        assert off, f"trace towards {towards_deg} deg: nothing is even possible"
        assert max(off) < 2.0
        only_possible += not seen.taken
        assert all(p.rule == "at_known_place" for p in possible)
    assert only_possible > 0, "what cannot be told by its looks alone is what `possible` is for"


def test_another_size_is_not_possible() -> None:
    seen, _ = next((s, c) for s, c in (_look(d, d // 10) for d in range(0, 360, 10)) if not s.taken)
    assert seen.possible(6.25)
    assert not seen.possible(5.2)
    assert not seen.possible(8.0)


def test_of_a_drilled_via_the_trace_is_thrown_in_every_direction() -> None:
    taken = 0
    for k, towards_deg in enumerate(range(0, 360, 10)):
        seen, centre = _look(towards_deg, k, HOLE_PX, TIGHT_PX)
        followed = seen.possible(6.25, followed=True)
        off = [np.hypot(p.x_px - centre[0], p.y_px - centre[1]) for p in (*seen.taken, *followed)]
        assert off, f"trace towards {towards_deg} deg: the via itself is not even possible"
        assert max(off) < 1.0
        taken += len(seen.taken) == 1
    assert taken > 30, "most are told by their looks alone"
