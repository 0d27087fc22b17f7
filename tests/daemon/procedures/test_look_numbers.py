"""What the journal keeps of a look."""

from __future__ import annotations

from dataclasses import replace

from daemon.procedures.look_numbers import describe
from daemon.station.station import LookResult
from drivers.gantry import Position
from tests.daemon.procedures.fake_station import found_tip, frame

AT = Position(50_000.0, 40_000.0, 5_200.0, 0.0)


def test_numbers_of_the_needle_are_kept_once_where_they_were_measured() -> None:
    """Of a tip that was carried they would be those of another picture: maintenance follows them over months."""
    tip = found_tip(800.0, 600.0)
    whole = describe(LookResult(frame(1), None, AT, tip, tip_px := (800.0, 620.0)), None, None)
    assert "needle" in whole
    assert "tip_by" not in whole
    carried = describe(LookResult(frame(1), None, AT, replace(tip, by_marking=True), tip_px), None, None)
    assert "needle" not in carried
    assert carried["tip_by"] == "marking"
    assert carried["tip_px"] == [800.0, 600.0]
