"""Looks at a drawn board whose picture leaves a tie: what the verified seat decides is measured and witnessed too."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from daemon.station.board_view import BoardSearch, BoardSeen, HeadView, accept, see_board, settle
from daemon.station.wide_view import Bend
from drivers.gantry import Position
from tests.daemon.procedures.fake_station import found_tip, pose_map
from tests.vision.registration.drawn import TIP_PX, Lie, Shot, moved, pin_row, shoot, some_board
from vision import Tip
from vision.geometry import Array
from vision.registration import (
    NotRegistered,
    Refusal,
    Registration,
    SideLayers,
    draw_whole,
    index_side,
    prepare,
)

LAYERS, PINS = pin_row(16)
PIN = PINS[8]
LIE = Lie(60.0, -40.0)
TIP = found_tip(*TIP_PX)


@dataclass(frozen=True)
class DrawnView(HeadView):
    """The head over a drawn board: the map to pixels is the drawing's own."""

    shot: Shot
    scale: float = 1.0

    def board_to_px(self, _tip: Tip, _about_um: tuple[float, float]) -> Array:
        return _scaled(self.scale) @ self.shot.assumed


def _scaled(scale: float) -> Array:
    """Return what makes a picture larger about the tip."""
    x, y = TIP_PX
    return np.array([[scale, 0.0, x - scale * x], [0.0, scale, y - scale * y], [0.0, 0.0, 1.0]])


def _look(layers: SideLayers = LAYERS) -> BoardSeen:
    """See a pin in the middle of its row, both ends of which are out of the frame."""
    shot = shoot(layers, PIN, LIE, np.random.default_rng(9))
    here = index_side(LAYERS)
    sides: Any = SimpleNamespace(here=here, whole=lambda: (draw_whole(here), None))
    view = DrawnView(cast("Any", None), pose_map(), Position(0.0, 0.0, 0.0, 0.0), 0.0, shot)
    reference = prepare(here, (PIN.x_um, PIN.y_um))
    search = BoardSearch(view, reference, None, sides, Bend(np.eye(3), 0.0), round_um=1700.0, hole_um=1000.0)
    return see_board(shot.frame, TIP, search)


def _frame(seen: BoardSeen) -> Any:
    return cast("DrawnView", seen.search.view).shot.frame


@pytest.fixture(scope="module")
def tie() -> BoardSeen:
    return _look()


def test_a_pin_within_a_long_row_is_a_tie_until_the_seat_settles_it(tie: BoardSeen) -> None:
    assert isinstance(tie.found, NotRegistered)
    assert tie.found.reason is Refusal.AMBIGUOUS
    settled = settle(tie, _frame(tie), TIP, (0.0, 0.0))
    assert isinstance(settled.found, Registration)
    assert math.dist(settled.found.shift_um, (LIE.x_um, LIE.y_um)) < 10.0
    assert settled.left_open is tie.found


def test_a_settled_place_has_its_witness(tie: BoardSeen) -> None:
    settled = settle(tie, _frame(tie), TIP, (0.0, 0.0))
    assert isinstance(settled.found, Registration)
    assert tie.witness is None
    assert settled.witness is not None
    assert math.dist((settled.witness.x_px, settled.witness.y_px), settled.found.target_px) < 2.0


def test_a_settled_place_whose_outline_lies_elsewhere_has_a_witness_there() -> None:
    hole = replace(LAYERS.holes[8], x_um=PIN.x_um + 70.0)
    seen = _look(replace(moved(LAYERS, PIN, 70.0, 0.0), holes=(*LAYERS.holes[:8], hole, *LAYERS.holes[9:])))
    settled = settle(seen, _frame(seen), TIP, (0.0, 0.0))
    assert isinstance(settled.found, Registration)
    assert settled.witness is not None
    seen_px, there = (settled.witness.x_px, settled.witness.y_px), replace(PIN, x_um=PIN.x_um + 70.0)
    assert math.dist(seen_px, cast("DrawnView", seen.search.view).shot.truth_px(there)) < 1.0
    assert math.dist(seen_px, settled.found.target_px) > 2.0


def test_what_was_registered_anew_stays_so_when_it_is_settled(tie: BoardSeen) -> None:
    settled = settle(replace(tie, moved=True), _frame(tie), TIP, (0.0, 0.0))
    assert isinstance(settled.found, Registration)
    assert settled.moved


def test_a_place_where_nothing_lies_settles_nothing(tie: BoardSeen) -> None:
    assert settle(tie, _frame(tie), TIP, (1270.0, 600.0)) is tie


def test_a_poor_view_that_is_accepted_has_its_witness(tie: BoardSeen) -> None:
    measured = settle(tie, _frame(tie), TIP, (0.0, 0.0)).found
    assert isinstance(measured, Registration)
    poor = replace(tie, found=NotRegistered(Refusal.NOT_THIS_BOARD, "little metal", measured), moved=True)
    accepted = accept(poor, _frame(poor), TIP, measured)
    assert accepted.found is measured
    assert accepted.left_open is poor.found
    assert accepted.witness is not None
    assert accepted.moved


LESS = 0.987
"""As a board 0.8 mm farther off than the map was made for."""


def _seen_larger(scale: float, bend: Bend | None, height_um: float) -> tuple[BoardSeen, float]:
    """See a board by a map that has it `scale` times as large; return also how far off its far pads are taken, px."""
    layers, targets = some_board(3)
    target = min(targets, key=lambda t: math.hypot(t.x_um - 18_000, t.y_um - 14_000))
    shot = shoot(layers, target, LIE, np.random.default_rng(3))
    here = index_side(layers)
    sides: Any = SimpleNamespace(here=here, whole=lambda: (draw_whole(here), None))
    view = DrawnView(cast("Any", None), pose_map(), Position(0.0, 0.0, 0.0, 0.0), height_um, shot, scale)
    seen = see_board(shot.frame, TIP, BoardSearch(view, prepare(here, (target.x_um, target.y_um)), None, sides, bend))
    found = seen.found
    if not isinstance(found, Registration):
        return seen, math.inf
    far = [t for t in targets if 4000 < math.hypot(t.x_um - target.x_um, t.y_um - target.y_um) < 7000]
    ways = []
    for one in far:
        x, y, w = seen.board_to_px @ (one.x_um + found.shift_um[0], one.y_um + found.shift_um[1], 1.0)
        ways.append(math.hypot(x / w - shot.truth_px(one)[0], y / w - shot.truth_px(one)[1]))
    return seen, float(np.median(ways))


def test_what_holds_at_this_height_is_not_learned_again() -> None:
    seen, off_px = _seen_larger(1.0, Bend(np.eye(3), 20.0), 0.0)
    assert seen.bend is None
    assert off_px < 1.0


@pytest.mark.parametrize("known", [None, Bend(_scaled(0.997), -400.0)])
def test_at_another_height_the_far_parts_are_learned_again(known: Bend | None) -> None:
    """So that a view of a lower surface is not judged by what a higher one looked like."""
    seen, off_px = _seen_larger(LESS, known, 0.0)
    assert seen.bend is not None
    assert seen.bend.height_um == 0.0
    assert off_px < 0.6


def test_where_a_board_lies_lower_than_the_one_before_its_far_parts_are_learned_again() -> None:
    seen, off_px = _seen_larger(LESS, Bend(np.eye(3), 0.0), 0.0)
    assert seen.bend is not None
    assert off_px < 0.6


def test_another_board_teaches_nothing_at_a_height_that_is_known() -> None:
    layers, targets = some_board(8)
    target = targets[5]
    shot = shoot(layers, target, Lie(), np.random.default_rng(3))
    here = index_side(some_board(3)[0])
    sides: Any = SimpleNamespace(here=here, whole=lambda: (draw_whole(here), None))
    view = DrawnView(cast("Any", None), pose_map(), Position(0.0, 0.0, 0.0, 0.0), 0.0, shot)
    bend = Bend(np.eye(3), 0.0)
    seen = see_board(shot.frame, TIP, BoardSearch(view, prepare(here, (target.x_um, target.y_um)), None, sides, bend))
    assert isinstance(seen.found, NotRegistered)
    assert seen.bend is None
    assert seen.board_to_px == pytest.approx(shot.assumed)
