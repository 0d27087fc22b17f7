"""The judge of the demonstration: what counts as the pad that was meant."""

from __future__ import annotations

import pytest

from daemon.domain.board import BoardPoint
from daemon.domain.results import JobResult
from daemon.tools.demo.true_place import Touched, off_um, same_net

PAD = BoardPoint(
    name="R4.1", kind="pad", x_um=3000.0, y_um=3000.0, net="/SENSOR/ADC_IN_CHANNEL_3", shape="rectangle",
    metal_um=((2500, 2500, 3500, 2500, 3500, 3500, 2500, 3500),),
)  # fmt: skip


def _result(**detail: object) -> JobResult:
    return JobResult(
        id="j", op="correct", ok=True, outcome="corrected", seq=1, station="s", finished_at="2026-01-01T00:00:00Z",
        detail=detail,
    )  # fmt: skip


def test_a_site_on_the_pad_is_where_the_needle_belongs() -> None:
    assert off_um(PAD, _result(target_um=[3300.0, 3300.0]), (3300.0, 3310.0)) == pytest.approx(10.0)


@pytest.mark.parametrize("said", [[9000.0, 9000.0], None, "here", [1.0]])
def test_a_site_elsewhere_is_not_believed(said: object) -> None:
    assert off_um(PAD, _result(target_um=said), (9000.0, 9000.0)) == pytest.approx(8485.3, abs=0.1)


@pytest.mark.parametrize(
    ("touched", "is_it"),
    [
        (Touched("metal", "/SENSOR/ADC_IN_CHANNEL_3", "R4.1"), True),
        (Touched("metal", "DC_IN_CHANNEL_3", "R4.1"), True),
        (Touched("metal", None, None), True),
        (Touched("metal", "GND", "R4.2"), False),
        (Touched("mask", None, None), False),
        (Touched("off_board", None, None), False),
    ],
)
def test_only_metal_of_its_net_is_the_pad(touched: Touched, is_it: bool) -> None:  # a row of a table
    assert touched.is_of(PAD) is is_it


def test_names_cut_by_the_netlist_are_the_same_net() -> None:
    assert same_net("/SENSOR/ADC_IN", "/sensor/adc_in_channel_3")
    assert not same_net("GND", "GNDA")
