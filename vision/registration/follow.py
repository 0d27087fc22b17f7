"""Following: a board registered a moment ago is measured again, finely, and asked whether it is still that board."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vision.core import Bgr
from vision.registration import wide
from vision.registration.answer import NotRegistered, Refusal, Registration, Target
from vision.registration.fine import judge
from vision.registration.lean import beside_parts
from vision.registration.rectify import Pose
from vision.registration.reference import Reference
from vision.registration.refine import Problem, refine
from vision.registration.register import decide, open_picture

CAPTURE_UM = 120.0
"""From look to look the board does not go farther; what does has been moved."""


def follow(
    reference: Reference,
    red_bgr: Bgr,
    board_to_px: NDArray[np.float64],
    target: Target | None,
    last: Registration,
    hidden_px: Sequence[NDArray[np.float64]] = (),
) -> Registration | NotRegistered:
    """Measure again a board that `last` says where it lies, in the same frame, within 0.1 mm; arguments as `register`.

    Its rivals are those of `last`, which were told apart then. A board that moved or was exchanged is WRONG_PLACE.
    """
    picture = open_picture(red_bgr, board_to_px, hidden_px)
    if isinstance(picture, NotRegistered):
        return picture
    reference = beside_parts(reference, picture)
    start = Pose(*last.shift_um, last.turn_deg, reference.about_um)
    per_um = 1.0 / picture.um_per_px(*start.apply(*reference.about_um))
    middle, broad = reference.middle, reference.wide
    problem = Problem(middle, picture, middle.planes.grid.cell_um * per_um, 2, most=500, turning=False, still_cells=0.3)
    fit = refine(problem, start)
    if fit is None or math.hypot(fit.pose.x_um - start.x_um, fit.pose.y_um - start.y_um) > CAPTURE_UM:
        return NotRegistered(Refusal.WRONG_PLACE, "the board is not where it was a look ago: register it again")
    cell_um = broad.planes.grid.cell_um
    shown = wide.look(picture, reference.about_um, cell_um, cell_um * per_um)
    levels = wide.wide_levels(broad, shown, fit.pose, fit.levels)
    agrees = wide.agreement(broad, shown, wide.draw_view(broad, shown, fit.pose, levels))
    answer = decide(judge(reference, picture, fit, target, last.rivals, agrees))
    if isinstance(answer, NotRegistered) and answer.reason is Refusal.NOT_THIS_BOARD:
        return NotRegistered(Refusal.WRONG_PLACE, f"it was a look ago, but now {answer.message}", answer.best)
    return answer
