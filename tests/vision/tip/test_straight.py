"""A bend is told by edges of the needle, not by those of the ground beside it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from vision import ProbeModel, Reason
from vision.tip.edges import EdgePoints, fit_axis
from vision.tip.measure import MeasuredTip
from vision.tip.orientation import Turn
from vision.tip.straight import BEND_CERTAIN_SIGMAS, BEND_LIMIT_PX, check_straight


class Seen:
    """A needle as the calipers see it: how far each side of its taper lies off, px at the end; parts may be unseen."""

    def __init__(self, model: ProbeModel, left_px: float, right_px: float, cylinder_edges: int = 1000) -> None:
        outline = model.outline
        u, on_taper = np.tile(outline.u_px, 2), np.tile(outline.on_taper, 2)
        side = np.repeat([-1.0, 1.0], outline.u_px.size)
        taught = np.concatenate([outline.left_px, outline.right_px])
        off_px = np.where(side < 0.0, left_px, right_px) * on_taper * (1.0 + u / model.h_px)
        rng = np.random.default_rng(1)
        v = taught + off_px + rng.normal(0.0, 0.1, u.size)
        kept = on_taper | (np.cumsum(~on_taper) <= cylinder_edges)
        v[kept & ~on_taper] += 0.0 if cylinder_edges > 100 else 4.0
        whole = EdgePoints(u, v, side, taught, on_taper, np.ones(u.size, dtype=bool), np.full(u.size, 20.0), u.size,
                           int(on_taper.sum()))  # fmt: skip
        points = whole.where(kept, whole.offered, whole.offered_on_taper)
        axis, free = fit_axis(points, -model.h_px), fit_axis(points, -model.h_px, straight=False)
        assert axis is not None
        assert free is not None
        self.free = free
        unused: Any = None
        self.probe = MeasuredTip(unused, unused, points, axis, free, Turn(1.0, 1.0, 1.0, 0.0), 0.0, 1.0, unused, 200.0,
                                 20.0)  # fmt: skip

    @property
    def claims_a_bend(self) -> bool:
        """Whether the fit through all edges says that the taper is turned."""
        return abs(self.free.bend_px) > max(BEND_LIMIT_PX, BEND_CERTAIN_SIGMAS * self.free.bend_sigma_px)


@pytest.mark.parametrize("bend_px", [-6.0, -3.0, 3.0, 6.0])
def test_a_taper_whose_sides_turn_alike_is_bent(model: ProbeModel, bend_px: float) -> None:
    problem = check_straight(Seen(model, bend_px, 0.7 * bend_px).probe, model)
    assert problem is not None
    assert problem.reason is Reason.BENT


@pytest.mark.parametrize(("left_px", "right_px"), [(-3.0, 2.0), (-3.0, 1.4), (-5.0, 1.0), (1.5, -6.0)])
def test_where_the_sides_of_a_taper_turn_apart_it_is_the_ground(
    model: ProbeModel, left_px: float, right_px: float
) -> None:
    """As beside the edge of a bright pad that crosses the taper."""
    seen = Seen(model, left_px, right_px)
    assert seen.claims_a_bend
    assert check_straight(seen.probe, model) is None


def test_without_the_cylinder_no_bend_is_told(model: ProbeModel) -> None:
    """Before a part as bright as the needle only its taper stands out."""
    seen = Seen(model, 0.0, 0.0, cylinder_edges=3)
    assert seen.claims_a_bend
    assert check_straight(seen.probe, model) is None
