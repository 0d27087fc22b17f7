"""Dashboards: every query in them is run by the real PostgreSQL and the real Prometheus, and gives something."""

from __future__ import annotations

import asyncio
import json
import re
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from prometheus_client import start_http_server

from daemon.fleet.batch import Batch, lost_row
from daemon.fleet.counts import Counts
from daemon.fleet.database import Arrived, Connection, Database, State, Taken
from daemon.fleet.rollups import roll_up
from daemon.fleet.topics import StationPath
from daemon.telemetry.metrics import Metrics
from daemon.telemetry.vitals import Vitals
from tests.fleet.dashboards import FILES, GRAFANA, dashboards, filled_in
from tests.fleet.engines import Prometheus

RULES = GRAFANA.parent / "prometheus-rules.yml"
VARIABLES = {"station": "station-1", "board": "demo", "board_id": "B-1"}
STATIONS = [StationPath("north", "L1", f"station-{n}") for n in (1, 2, 3)]


def _targets(kind: str) -> list[tuple[str, dict[str, Any]]]:
    """Return all queries for one kind of data source, with the title of their panel."""
    return [
        (f"{board['title']}: {panel['title']}", target)
        for board in dashboards()
        for panel in board["panels"]
        for target in panel["targets"]
        if target["datasource"]["type"] == kind
    ]


def _filled_in(query: str) -> str:
    return filled_in(query, VARIABLES)


def test_each_dashboard_is_one_of_its_own_and_its_panels_overlap_nowhere() -> None:
    boards = dashboards()
    assert [file.stem for file in FILES] == ["board-design", "fleet", "needles", "station"]
    assert len({board["uid"] for board in boards}) == len(boards)
    for board in boards:
        fields: set[tuple[int, int]] = set()
        for panel in board["panels"]:
            at = panel["gridPos"]
            own = {(x, y) for x in range(at["x"], at["x"] + at["w"]) for y in range(at["y"], at["y"] + at["h"])}
            assert not own & fields, panel["title"]
            assert at["x"] + at["w"] <= 24, panel["title"]
            fields |= own


def test_data_sources_of_panels_are_the_shipped_ones() -> None:
    shipped = set(re.findall(r"uid: (\S+)", (GRAFANA / "datasources.yml").read_text()))
    used = {target["datasource"]["uid"] for kind in ("postgres", "prometheus") for _, target in _targets(kind)}
    assert used == shipped


def test_every_variable_of_a_query_is_one_of_its_dashboard() -> None:
    for board in dashboards():
        known = {one["name"] for one in board["templating"]["list"]}
        text = json.dumps(board["panels"])
        assert set(re.findall(r"\$(?!__)(\w+)", text)) <= known, board["title"]


# --- PostgreSQL ---------------------------------------------------------------------------------------------------


def _row(seq: int, kind: str, **body: Any) -> dict[str, Any]:
    around = {"program": "1.0", "configuration": "c0", "board": "demo", "needle": "N-1", "tip": "t1"}
    at = datetime.now(UTC).isoformat()
    return {"seq": seq, "kind": kind, "at": at, "body": {"n": seq, **body}, "circumstances": around}


async def _plant(database: Database, path: StationPath) -> Taken:
    """Store something of each kind that a query asks for: a point that misses at every station, a hole, an alert."""
    rows = [lost_row(1, 3)]
    recovered = {"point": "TP4", "board_id": "B-1", "verdict": "pass_recovered", "recovered_by": "look"}
    rows += [_row(n, "point", **recovered) for n in range(4, 24)]
    rows.append(_row(24, "touch", point="TP4", board_id="B-1", value=0.2))
    rows.append(_row(25, "alert", name="light_white", change="raised", severity="warning", message="dim"))
    detail = {"theta_deg": 90.0}
    rows.append(_row(26, "result", id="j", op="correct", ok=True, error_before_um=30.0, detail=detail))
    return await database.take([Arrived(path, Batch("J", 1, None, 0, rows))])


async def test_every_query_for_the_database_gives_rows(database: Database, connection: Connection) -> None:
    for path in STATIONS:
        await _plant(database, path)
        await database.set_states([State(path, {"online": True, "state": "idle"}, "{}")])
    await roll_up(connection)
    asked = [(title, _filled_in(target["rawSql"])) for title, target in _targets("postgres")]
    asked += [
        (f"{board['title']}: ${one['name']}", one["query"])
        for board in dashboards()
        for one in board["templating"]["list"]
        if one["type"] == "query"
    ]
    assert len(asked) > 15
    for title, query in asked:
        assert await connection.fetch(query), title
    series = [(title, _filled_in(t["rawSql"])) for title, t in _targets("postgres") if t["format"] == "time_series"]
    for title, query in series:
        assert {"time", "metric", "value"} == set((await connection.fetch(query))[0].keys()), title


async def test_the_time_of_a_series_is_one(database: Database, connection: Connection) -> None:
    await _plant(database, STATIONS[0])
    await roll_up(connection)
    for title, target in _targets("postgres"):
        if target["format"] == "time_series":
            (row, *_) = await connection.fetch(_filled_in(target["rawSql"]))
            assert isinstance(row["time"], datetime), title
            assert row["time"].tzinfo is not None, title


# --- Prometheus ---------------------------------------------------------------------------------------------------


@pytest.fixture
def figures() -> Metrics:
    daemon = Metrics("station-1", "1.0")
    daemon.watch(lambda: Vitals("not_homed", 0, 9, 4096, {"map": 60.0}, {}, {}))
    daemon.take("alert", {"name": "light_white", "raised": True})
    return daemon


@pytest.fixture
def counts() -> Counts:
    return Counts()


@pytest.fixture
def prometheus(tmp_path: Path, figures: Metrics, counts: Counts) -> Iterator[Prometheus]:
    """Prometheus with the shipped rules over the figures of one station and of a collector."""
    served = [start_http_server(0, addr="127.0.0.1", registry=one.registry) for one in (figures, counts)]
    labels = ({"site": "north", "line": "L1", "station": "station-1"}, dict[str, str]())
    jobs = zip(("reprobe", "reprobe-collect"), served, labels, strict=True)
    targets = {job: [(f"127.0.0.1:{server.server_address[1]}", own)] for job, (server, _), own in jobs}
    found = Prometheus(tmp_path, RULES, targets)
    found.start()
    yield found
    found.stop()
    for server, thread in served:
        server.shutdown()
        server.server_close()
        thread.join()


def _work_on(figures: Metrics, counts: Counts) -> None:
    """Let both count on, as they do while boards are tested."""
    for n in range(30):
        failed = {"name": "tip_not_found"} if n == 0 else None
        figures.take("result", {
            "op": "correct", "outcome": "failed" if failed else "corrected", "error": failed, "timing_ms": {},
            "looks": 2, "moves": 1, "error_before_um": 30.0, "error_after_um": 8.0,
        })  # fmt: skip
    figures.report(None, 1)
    arrived = [Arrived(STATIONS[0], Batch("J", 1, None, 0, []))]
    counts.stored(arrived, Taken([], 10, [], []))


@pytest.mark.timeout(120)
async def test_every_query_for_prometheus_gives_samples(
    prometheus: Prometheus, figures: Metrics, counts: Counts
) -> None:
    left = {(title, target["refId"]): _filled_in(target["expr"]) for title, target in _targets("prometheus")}
    assert len(left) > 8
    while left:  # the test's own timeout ends it, and says which are left
        _work_on(figures, counts)
        left = {name: query for name, query in left.items() if not prometheus.ask(query)}
        await asyncio.sleep(0.2)
