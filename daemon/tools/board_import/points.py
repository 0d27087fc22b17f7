"""Points of one side: every bare pad of the netlist with its target or its reason, fiducials, and what is hidden."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from daemon.domain.board import BoardPoint, Form, Kind
from daemon.tools.board_import.frame import SideCad
from daemon.tools.board_import.names import PinRoles, net_of, unique
from daemon.tools.board_import.pads import HoleFinder, Openings, Pad, bare_pads
from daemon.tools.board_import.parts import Part
from daemon.tools.board_import.preference import Class, class_of, ranked
from daemon.tools.board_import.rounds import (
    RoundFlashes,
    alike,
    exact_round,
    is_fiducial_like,
    stands_out,
    unnamed_places,
)
from daemon.tools.board_import.targets import Form2D, form_of
from daemon.tools.board_import.verdict import Judge, Verdict
from daemon.tools.cad.model import Pin

SMALL_VIA_UM = 300.0
"""A drilled test point smaller than this is called a via (thesis 5.4.1: vias are the small ones with a hole)."""
LARGEST_BY_OUTLINE_UM = 1600.0
"""A larger round does not fit the window in which a round outline is looked for."""
OFF_MIDDLE_UM = 10.0


@dataclass(frozen=True, slots=True)
class Found:
    """What one side has: its points, named points it lacks -> why, outlines of its soldered pads."""

    points: tuple[BoardPoint, ...]
    hidden: dict[str, str]
    hidden_nets: dict[str, tuple[str, str]]
    """Hidden name -> its net, why."""
    soldered: list[tuple[int, ...]]


class PointFinder:
    """Finds the points of one side."""

    def __init__(self, side: SideCad, openings: Openings, names: Sequence[str], roles: PinRoles) -> None:
        self._side, self._openings, self._names, self._roles = side, openings, names, roles
        self._flashes = RoundFlashes(side.copper, side), RoundFlashes(side.mask, side)

    def find(
        self, judge: Judge, parts: dict[str, Part], elsewhere: np.ndarray[tuple[int, ...], np.dtype[np.float64]]
    ) -> Found:
        """Look at every pin, then at round metal without a name; elsewhere: pins of a panel's other boards, um."""
        side, holes = self._side, HoleFinder(self._side)
        pins, places = side.pins, side.places
        groups = [f"via {p.net}" if p.is_via else name for p, name in zip(pins, self._names, strict=True)]
        chosen = [i for i, p in enumerate(pins) if side.side in p.access and not (p.is_via and side.side in p.covered)]
        lands = {groups[i] for i, p in enumerate(pins) if not p.is_via}
        found: dict[int, tuple[BoardPoint, Class | None]] = {}
        sizes = [_area_um2(p) for p in pins]
        for pad in bare_pads(side, self._openings, holes, places, chosen, groups, sizes):
            pin, shape = pins[pad.index], self._exactly(pad, form_of(pad))
            point = self._point(pad, pin, shape, judge.judge(pad, shape, pin))
            in_pad = pin.is_via and not lands.isdisjoint(pad.groups)
            found[pad.index] = point, self._class(point, pin, parts, in_pad=in_pad)
        order = sorted(found)
        points = [found[i][0] for i in order]
        classes = [found[i][1] for i in order]
        soldered = [o for i in order if pins[i].part in parts and not pins[i].is_via for o in found[i][0].metal_um]
        others = self._unnamed(holes, elsewhere)
        points += others
        classes += [None] * len(others)
        unseen = {
            self._names[i]: (pin, self._why_hidden(pin, i))
            for i, pin in enumerate(pins)
            if i not in found and not pin.is_via
        }
        return Found(
            points=ranked(points, classes),
            hidden={name: why for name, (_, why) in unseen.items()},
            hidden_nets={name: (pin.net, why) for name, (pin, why) in unseen.items()},
            soldered=soldered,
        )

    def _class(self, point: BoardPoint, pin: Pin, parts: dict[str, Part], *, in_pad: bool) -> Class | None:
        if not point.probeable:
            return None
        test_point = self._roles.is_test_point(pin)
        return class_of(point, test_point=test_point, single=pin.part not in parts, in_pad=in_pad)

    def _exactly(self, pad: Pad, shape: Form2D) -> Form2D:
        """Put the place and diameter of the flash in that painted something round."""
        if shape.diameter is not None:
            exact = exact_round(self._flashes, *shape.centre, shape.diameter)
            return replace(shape, centre=exact[:2], diameter=exact[2]) if exact is not None else shape
        for layer in self._flashes:
            for x, y, diameter in layer.at(pad.x, pad.y):
                if stands_out(pad, (x, y, diameter)):
                    form: Form = "ring" if pad.hole is not None and not pad.hole.filled else "round"
                    return Form2D(form, diameter, (x, y), None, diameter, shape.outlines)
        return shape

    def _point(self, pad: Pad, pin: Pin, shape: Form2D, verdict: Verdict) -> BoardPoint:
        target, diameter, middle = verdict.target, shape.diameter, shape.centre
        at = (target.x, target.y) if target is not None else middle
        aside = diameter is not None and np.hypot(at[0] - middle[0], at[1] - middle[1]) >= OFF_MIDDLE_UM
        by_outline = diameter is not None and diameter <= LARGEST_BY_OUTLINE_UM
        hole = pad.hole.diameter if pad.hole is not None and not pad.hole.filled else None
        return BoardPoint(
            name=self._names[pad.index],
            kind=self._kind(pin, diameter, hole),
            x_um=round(at[0], 2),
            y_um=round(at[1], 2),
            diameter_um=round(diameter, 1) if diameter is not None and by_outline else None,
            hole_um=round(hole, 1) if hole is not None else None,
            net=net_of(pin),
            why_not=verdict.why_not,
            part=pin.part or None,
            pin=pin.pin or None,
            shape=shape.form,
            centre_um=(round(middle[0], 2), round(middle[1], 2)) if aside and by_outline else None,
            metal_um=shape.outlines,
            room_um=round(target.room, 1) if target is not None else None,
        )

    def _kind(self, pin: Pin, diameter: float | None, hole: float | None) -> Kind:
        if self._roles.is_fiducial(pin):
            return "fiducial"
        if pin.is_via:
            return "via"
        if self._roles.is_test_point(pin):
            return "via" if hole is not None and diameter is not None and diameter < SMALL_VIA_UM else "site"
        return "pin" if hole is not None else "pad"

    def _why_hidden(self, pin: Pin, index: int) -> str:
        """Say why a pin of the netlist shows no metal here."""
        side = self._side.side
        if side not in pin.access:
            return f"it lies on the {'bottom' if side == 'top' else 'top'}"
        if side in pin.covered or not self._openings.at(*self._side.places[index]):
            return "solder mask covers it"
        return "no copper of it shows in the mask's opening"

    def _unnamed(
        self, holes: HoleFinder, elsewhere: np.ndarray[tuple[int, ...], np.dtype[np.float64]]
    ) -> list[BoardPoint]:
        """Return round metal that no netlist entry lies on: fiducials, where there are three alike, and the rest."""
        copper, mask = self._flashes
        named = np.vstack((self._side.places.reshape(-1, 2), elsewhere.reshape(-1, 2)))
        chosen = unnamed_places(copper, named)
        pads = [
            pad
            for pad in bare_pads(
                self._side, self._openings, holes, copper.middles, chosen, [f"{i}" for i in range(len(copper.middles))]
            )
            if pad.hole is None or not pad.hole.filled
        ]
        pads.sort(key=lambda pad: pad.index)
        shapes = [form_of(pad) for pad in pads]
        rounds = [exact_round(self._flashes, *s.centre, s.diameter) if s.diameter else None for s in shapes]
        sizes = [is_fiducial_like(p, r[2] if r else None, mask) for p, r in zip(pads, rounds, strict=True)]
        good = alike(sizes)
        wanted = ["FID" if g else "PAD" for g in good]
        numbers = {"FID": 0, "PAD": 0}
        names = []
        for kind in wanted:
            numbers[kind] += 1
            names.append(f"{kind}{numbers[kind]}")
        free = unique([*self._names, *names])[len(self._names) :]
        return [
            _unnamed_point(name, pad, shape, exact, fiducial=fiducial)
            for name, pad, shape, exact, fiducial in zip(free, pads, shapes, rounds, good, strict=True)
            if exact is not None and exact[2] <= LARGEST_BY_OUTLINE_UM
        ]


def _area_um2(pin: Pin) -> float | None:
    """Return the area of a pin's pad as far as it is told: of the round, or of the box."""
    if not pin.width_mm:
        return None
    return (pin.width_mm * pin.height_mm if pin.height_mm else np.pi / 4 * pin.width_mm**2) * 1e6


def _unnamed_point(
    name: str, pad: Pad, shape: Form2D, exact: tuple[float, float, float], *, fiducial: bool
) -> BoardPoint:
    hole = pad.hole.diameter if pad.hole is not None else None
    return BoardPoint(
        name=name,
        kind="fiducial" if fiducial else "site",
        x_um=round(exact[0], 2),
        y_um=round(exact[1], 2),
        diameter_um=round(exact[2], 1),
        hole_um=round(hole, 1) if hole is not None else None,
        shape="round" if hole is None else "ring",
        metal_um=shape.outlines,
        why_not="a fiducial" if fiducial else "not in the netlist",
    )
