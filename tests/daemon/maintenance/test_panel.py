"""The panel feeds the right watch, begins anew with what it learned on, and is rebuilt from what was kept."""

import json
import random
from collections.abc import Iterator

import pytest

from daemon.config.sections.service import MaintenanceSection
from daemon.config.watch_names import GROUPS, is_known, sector_name, watch_names
from daemon.maintenance.catalogue import all_specs, chosen
from daemon.maintenance.panel import Panel, Row
from tests.bench.maintenance.histories import new_panel
from tests.bench.maintenance.model import StationModel
from tests.bench.maintenance.wrong import Wrong

BASES = {"probe": "p", "map": "m", "rotation": "r", "surface": "s", "alignment": "a"}


def _rows(values: list[float], bases: dict[str, str] | None = None) -> Iterator[Row]:
    for k, value in enumerate(values):
        yield Row("2026-11-24T00:00:00", k, f"job-{k}", {"light_white": [value]}, bases or BASES)


def _lit(n: int, level: float = 119.0, seed: int = 1) -> list[float]:
    rng = random.Random(seed)
    return [rng.gauss(level, 0.3) for _ in range(n)]


def _fed(panel: Panel, rows: Iterator[Row]) -> Panel:
    for row in rows:
        panel.take(row)
    return panel


def test_every_watch_has_a_name_of_its_own_a_known_group_and_advice() -> None:
    specs = list(all_specs(["main", "second"]))
    assert len({spec.name for spec in specs}) == len(specs)
    assert {spec.group for spec in specs} == set(GROUPS)
    assert all(spec.advice and spec.what for spec in specs)
    assert {"bus_timeouts_main", "bus_garbled_second", sector_name(359.9), "drive_theta", "more_moves"} <= {
        s.name for s in specs
    }


def test_a_watch_or_a_group_can_be_switched_off_and_nothing_else_is_known() -> None:
    names = set(chosen(["main"], off=("light", "noise"), baseline=60, batch=5))
    assert not {"light_white", "light_red", "noise"} & names
    assert "focus" in names
    assert is_known("light", ["main"])
    assert is_known("bus_garbled_main", ["main"])
    assert not is_known("bus_garbled_other", ["main"])


def test_windows_that_cannot_tell_anything_are_refused() -> None:
    with pytest.raises(ValueError, match="too short"):
        MaintenanceSection(baseline=10, batch=5)


def test_a_new_probe_begins_its_watches_anew_and_leaves_the_others() -> None:
    panel = _fed(new_panel(), _rows(_lit(80)))
    assert panel.watches["light_white"].standing.learned == 1.0
    panel.take(Row("t", 99, "", {"noise": [0.5]}, {**BASES, "probe": "another"}))
    assert panel.watches["light_white"].standing.learned == 0.0
    assert panel.watches["noise"].standing.learned > 0.0


def test_an_alignment_begins_the_bias_of_the_board_anew_but_not_the_head_s() -> None:
    panel = new_panel()
    for k in range(30):
        panel.take(Row("t", k, "", {"placement_x": [1.0 * k], "head_along": [1.0 * k]}, BASES))
    panel.take(Row("t", 31, "", {}, {**BASES, "alignment": "later"}))
    assert panel.watches["placement_x"].standing.learned == 0.0
    assert panel.watches["head_along"].standing.learned > 0.0


def test_what_was_learned_survives_a_restart_to_the_last_digit() -> None:
    station, whole, half = StationModel(7), new_panel(), new_panel()
    rows = [row for k in range(250) for row in station.rows(Wrong(bend_px=2.0 if k > 150 else 0.0))]
    _fed(whole, iter(rows))
    _fed(half, iter(rows[:300]))
    again = new_panel()
    assert again.restore(json.loads(json.dumps(half.to_dict()))) == []
    _fed(again, iter(rows[300:]))
    assert again.to_dict() == whole.to_dict()
    assert "tip_bend" in again.findings()


def test_a_damaged_memory_costs_only_the_watch_it_belongs_to() -> None:
    kept = _fed(new_panel(), _rows(_lit(80))).to_dict()
    kept["watches"]["noise"] = {"limits": "nonsense"}
    kept["watches"]["focus"] = 5
    panel = new_panel()
    assert sorted(panel.restore(kept)) == ["focus", "noise"]
    assert panel.watches["light_white"].standing.learned == 1.0


def test_rows_are_kept_as_json_and_come_back() -> None:
    row = Row("t", 3, "job", {"noise": [0.5]}, BASES, {"drive_x": "hot"})
    assert Row.from_dict("t", 3, "job", json.loads(json.dumps(row.to_dict()))) == row


def test_a_stream_nobody_watches_is_no_trouble() -> None:
    panel = new_panel()
    panel.take(Row("t", 0, "", {"weather": [1.0]}))
    assert panel.findings() == {}


def test_the_configuration_knows_the_names_of_just_these_watches() -> None:
    buses = ("main", "second")
    assert sorted(watch_names(buses)) == sorted(spec.name for spec in all_specs(buses))
    assert {spec.group for spec in all_specs(buses)} == set(GROUPS)
