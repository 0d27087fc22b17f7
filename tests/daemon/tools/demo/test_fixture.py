"""The truth of a point is that of its own pad, also where another of the net lies nearer to where it is touched."""

from __future__ import annotations

from typing import Any

import pytest

from daemon.domain.board import BoardPoint
from daemon.tools.demo.fixture import Fixture
from daemon.tools.demo.truth_log import Stretch

D4 = {"pin": "D4.1", "net": "VDD", "x_mm": 10.0, "y_mm": 5.0}
VIA = {"pin": "VIA", "net": "VDD", "x_mm": 10.0, "y_mm": 6.6}


class _Bench:
    def __init__(self, cut_off: dict[str, Any]) -> None:
        self._told = {
            "pads": {"side": "top", "outline_mm": (0.0, 0.0, 20.0, 10.0), "pads": [VIA, D4]},
            "circuit": {"cut_off": [cut_off], "harness": {"1": "VDD"}},
        }

    def ask(self, what: str) -> Any:
        return self._told[what]


def _fixture(cut_off: dict[str, Any]) -> Fixture:
    bench: Any = _Bench(cut_off)
    return Fixture(bench)


def _point(**facts: Any) -> BoardPoint:
    return BoardPoint.model_validate({"name": "D4.1", "kind": "pad", "net": "VDD", "part": "D4", "pin": "1", **facts})


@pytest.mark.parametrize(("cut_off", "sound"), [(VIA, True), (D4, False)])
def test_a_large_pad_that_is_touched_at_its_end_is_the_pin_s_and_not_the_via_s_beside_it(
    cut_off: dict[str, Any], sound: bool
) -> None:
    fixture, end_of_it = _fixture(cut_off), _point(x_um=10_000.0, y_um=6_055.0)
    assert fixture.is_sound(end_of_it, Stretch()) is sound
    assert fixture.net_of(end_of_it) == "VDD"


def test_of_two_pads_of_one_pin_it_is_the_nearer() -> None:
    far = {**D4, "x_mm": 2.0}
    bench: Any = _Bench(far)
    bench.ask("pads")["pads"].append(far)
    fixture = Fixture(bench)
    assert fixture.is_sound(_point(x_um=10_000.0, y_um=5_000.0), Stretch())
    assert not fixture.is_sound(_point(x_um=2_000.0, y_um=5_000.0), Stretch())


def test_a_via_is_known_by_its_place_and_none_is_taken_from_far() -> None:
    fixture = _fixture(VIA)
    via = {"name": "VIA3", "kind": "via", "part": None, "pin": None}
    assert not fixture.is_sound(_point(**via, x_um=10_000.0, y_um=6_700.0), Stretch())
    assert fixture.net_of(_point(**via, x_um=10_000.0, y_um=9_000.0)) is None
