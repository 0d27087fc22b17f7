"""Uplink, broker, database and collector as processes, and what becomes of records when they are killed."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import pytest

from tests.bench.fleet import ask, one_run, plant


@pytest.mark.timeout(400)
def test_ten_thousand_records_arrive_once_each_over_kills_of_every_part(tmp_path: Path) -> None:
    found = one_run(tmp_path, seed=1, records=10_000)
    assert found["stored"] == found["distinct"] == found["whole"] == 10_000, found
    assert found["refused"] == 0
    assert sum(found[part] for part in ("collector", "uplink", "broker", "database")) > 0


@pytest.mark.timeout(200)
def test_a_station_whose_uplink_is_ended_or_killed_is_told_offline(tmp_path: Path) -> None:
    with plant(tmp_path, {"station-1": 3, "station-2": 3}) as running:
        sql = "SELECT station, online, state FROM stations_now ORDER BY 1"
        for expected in (True, False):
            while [online for _, online, _ in ask(running.database, sql)] != [expected, expected]:
                time.sleep(0.2)
            if expected:
                running.uplinks[0].stop()
                running.uplinks[1].stop(signal.SIGKILL)
