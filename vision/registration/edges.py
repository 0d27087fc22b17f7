"""Metal edges that the picture confirms or contradicts: whether it gets brighter where CAD says metal begins."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vision.core import Plane
from vision.registration.answer import Edges
from vision.registration.drawing import Material
from vision.registration.refine import slopes
from vision.registration.sheet import Sheet

CONFIRMED, CONTRADICTED = 0.4, 0.15
"""Of the slope expected: at least, at most."""
LEAST_NEAR = 60
"""Cells of edge near a place without a target, without which the board's place is not believed."""
LEAST_CONFIRMED, LEAST_SOLDERED = 0.6, 0.55
"""Share of edges confirmed: of bare metal; of pads with solder, which stands up and throws the lamp elsewhere."""
LEAST_GROUP = 6
"""Fewer edge cells of a direction say nothing of their own."""
_STRONG = 0.15
"""An edge of metal: its share changes by so much from cell to cell."""


def judge_edges(
    sheet: Sheet,
    shown: Plane,
    expected: Plane,
    seen: NDArray[np.bool_],
    step: float,
    where: NDArray[np.bool_] | None = None,
    materials: tuple[Material, ...] = (Material.METAL,),
) -> Edges:
    """Compare the picture's slope across each edge of metal with the expected one; `where`: which cells are asked.

    materials: whose edges, together; ink where there is no metal to be seen.

    Edges across x and across y are judged apart, and the worse counts: a long pad displaced along itself has most of
    its edge still in place.
    """
    metal_x, metal_y = slopes(sheet.planes.cover[list(materials)].sum(axis=0))
    edge = np.hypot(metal_x, metal_y) > _STRONG
    if where is not None:
        edge &= where
    count = int(np.count_nonzero(edge))
    asked = edge & seen & (sheet.told if Material.SOLDER in materials else sheet.known)
    cells = int(np.count_nonzero(asked))
    if cells == 0 or step <= 0.0:
        return Edges(0.0, 0.0, 0, 1.0 if count else 0.0)
    want_x, want_y = (slope[asked] for slope in slopes(expected))
    got_x, got_y = (slope[asked] for slope in slopes(shown))
    expected_slope = np.hypot(want_x, want_y)
    plain = expected_slope > 0.05 * step
    share = np.where(plain, (want_x * got_x + want_y * got_y) / np.maximum(expected_slope, 1e-6) ** 2, 0.0)
    across_x = np.abs(metal_x[asked]) >= np.abs(metal_y[asked])
    groups = [share[plain & across_x], share[plain & ~across_x]]
    groups = [group for group in groups if len(group) >= LEAST_GROUP] or [share[plain]]
    if not len(groups[0]):
        return Edges(0.0, 0.0, 0, 1.0 - cells / count)
    confirmed = min(float(np.mean(group > CONFIRMED)) for group in groups)
    contradicted = max(float(np.mean(group < CONTRADICTED)) for group in groups)
    soldered = Material.SOLDER in materials
    return Edges(confirmed, contradicted, int(np.count_nonzero(plain)), 1.0 - cells / count, soldered)
