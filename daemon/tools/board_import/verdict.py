"""What may be done with one pad: where it is touched, or why it is not, in words with the number.

Without a drawing of the parts it is taken for granted that the free end of a part's pad is bare metal, and that the
body reaches to the middle of the pad; with `bare` no part is fitted, and every pad is touched in its middle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from daemon.tools.board_import.frame import Box, meeting
from daemon.tools.board_import.names import PinRoles
from daemon.tools.board_import.pads import Pad
from daemon.tools.board_import.parts import INNER_UM, Part, PartBody
from daemon.tools.board_import.raster import Picture
from daemon.tools.board_import.targets import (
    LARGEST_HOLE,
    LARGEST_MIDDLE_HOLE_UM,
    LEAST_NAMED_UM,
    LEAST_RING_UM,
    LEAST_ROUND_UM,
    LEAST_SIDE_UM,
    LEAST_TOE_UM,
    LEAST_VIA_UM,
    Form2D,
    Target,
    best_target,
    middle_target,
)
from daemon.tools.cad.model import Pin, Side


@dataclass(frozen=True, slots=True)
class Verdict:
    """The target of a pad, or why there is none."""

    target: Target | None
    why_not: str | None


class Judge:
    """Judges the pads of one side."""

    def __init__(
        self, side: Side, roles: PinRoles, parts: dict[str, Part], bodies: Sequence[PartBody], *, bare: bool
    ) -> None:
        self._side, self._roles, self._parts, self._bare = side, roles, parts, bare
        self._bodies = () if bare else tuple(bodies)
        self._boxes = np.array([b.box for b in self._bodies]).reshape(-1, 4)
        self._drawn = {b.part for b in self._bodies if b.drawn}

    def judge(self, pad: Pad, shape: Form2D, pin: Pin) -> Verdict:
        """Choose the target of a pad of that shape that a pin lies on."""
        refusal = self._by_the_netlist(pin)
        if refusal is not None:
            return Verdict(None, refusal)
        part = None if self._bare or pin.is_via or self._roles.is_test_point(pin) else self._parts.get(pin.part)
        if part is None:
            return self._alone(pad, pin, shape)
        if pad.hole is not None and not pad.hole.filled and pin.hole_mm is not None:
            if part.side == self._side:
                return Verdict(None, f"it lies under {part.name}, which stands on this side")
            return self._ring(pad, shape, self._forbidden(pad, but=None))
        return self._toe(pad, shape, part)

    def _by_the_netlist(self, pin: Pin) -> str | None:
        if self._roles.is_fiducial(pin):
            return "a fiducial"
        if self._side not in pin.access:
            return f"the netlist gives no access from the {self._side}"
        if self._side in pin.covered:
            return "the netlist says solder mask covers it"
        return None

    def _alone(self, pad: Pad, pin: Pin, shape: Form2D) -> Verdict:
        """Judge a via, a test point, or any pad of a board without parts."""
        forbidden = self._forbidden(pad, but=None)
        named = self._roles.is_test_point(pin)
        hole_um = pad.hole.diameter if pad.hole is not None and not pad.hole.filled else None
        where = pad.window.at(pad.x, pad.y)
        if where is not None and forbidden[where]:
            return Verdict(None, f"it lies under {self._part_over(pad)}")
        if shape.diameter is None or (forbidden & pad.metal).any():
            if hole_um is not None and not named:
                return self._ring(pad, shape, forbidden)
            least = LEAST_NAMED_UM if named else LEAST_SIDE_UM
            return self._wide_enough(best_target(pad, shape, forbidden, None), least, "its bare metal is")
        if hole_um is None:
            least = LEAST_NAMED_UM if named else LEAST_ROUND_UM
            return self._wide_enough(middle_target(shape), least, "its bare metal is")
        if hole_um <= min(LARGEST_HOLE * shape.diameter, LARGEST_MIDDLE_HOLE_UM):
            least = LEAST_NAMED_UM if named else LEAST_VIA_UM
            return self._wide_enough(middle_target(shape), least, "its pad is")
        return self._ring(pad, shape, forbidden)

    def _ring(self, pad: Pad, shape: Form2D, forbidden: Picture) -> Verdict:
        return self._wide_enough(best_target(pad, shape, forbidden, None), LEAST_RING_UM, "ring")

    def _toe(self, pad: Pad, shape: Form2D, part: Part) -> Verdict:
        """Judge a part's pad on the surface."""
        drawn = part.name in self._drawn
        if not drawn and (part.is_array or part.depth_um(pad.x, pad.y) > INNER_UM):
            return Verdict(None, f"it lies under {part.name}")
        if shape.width < LEAST_SIDE_UM - pad.window.pitch:
            return Verdict(None, f"its bare metal is {shape.width / 1e3:.2f} mm, needs {LEAST_SIDE_UM / 1e3:.2f}")
        outward = part.outward(pad.x, pad.y, shape.long_axis)
        forbidden = self._forbidden(pad, but=None if drawn else part.name)
        if not drawn:
            forbidden = forbidden | _inner_half(pad, shape.centre, outward)
        target = best_target(pad, shape, forbidden, outward)
        return self._wide_enough(target, LEAST_TOE_UM, f"what is free of it beyond {part.name} is")

    def _wide_enough(self, target: Target | None, least: float, what: str) -> Verdict:
        if target is None:
            return Verdict(None, "nothing of it is free")
        if 2 * target.room < least - 2.0:  # a pixel's share
            return Verdict(None, f"{what} {2 * target.room / 1e3:.2f} mm, needs {least / 1e3:.2f}")
        return Verdict(target, None)

    def _over(self, box: Box) -> list[PartBody]:
        return [self._bodies[i] for i in meeting(self._boxes, box)]

    def _forbidden(self, pad: Pad, but: str | None) -> Picture:
        """Paint the bodies over a pad's window; but: the part whose own guessed body is left out."""
        picture = pad.window.blank()
        for body in self._over(pad.window.box):
            if body.part is None or body.part != but:
                pad.window.fill(picture, body.polygon, 1)
        return picture

    def _part_over(self, pad: Pad) -> str:
        over = self._over((pad.x, pad.y, pad.x, pad.y))
        return next((b.part for b in over if b.part), "a part")


def _inner_half(pad: Pad, middle: tuple[float, float], outward: tuple[float, float]) -> Picture:
    """Paint the half of a pad's window that lies towards the part, as seen from the pad's middle."""
    column, row = pad.window.pixels(np.array(middle))
    along = (np.arange(pad.metal.shape[1]) - column) * outward[0]
    towards = along[None] + ((np.arange(pad.metal.shape[0]) - row) * outward[1])[:, None]
    half: Picture = (towards < 0.0).astype(np.uint8)
    return half
