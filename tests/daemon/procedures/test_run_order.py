"""Order of a run: the shortest way by the times that the axes take, with their approaches as they are now."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from daemon.procedures import run_order
from daemon.procedures.run_order import order_of
from daemon.station.travel_time import TravelTimes
from drivers.gantry import Approach
from tests.daemon.procedures.fake_station import ScriptedStation, World, a_board


def test_the_way_is_reckoned_with_the_approaches_that_are_in_force(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    world, now = World(tmp_path, a_board(("A", 9_000.0, 9_000.0)), {}), Approach(60.0, 0.0, 0.5)
    asked_with: list[Any] = []

    def times(*arguments: Any) -> TravelTimes:
        asked_with.append(arguments[2])
        return TravelTimes(*arguments)

    monkeypatch.setattr(ScriptedStation, "approach", now)
    monkeypatch.setattr(run_order, "TravelTimes", times)
    here = world.gantry.reported
    far, near = replace(here, x_um=here.x_um + 9_000.0), replace(here, x_um=here.x_um + 1_000.0)
    assert order_of(world.context, [far, near], here, short=True) == [1, 0]
    assert asked_with == [now]
