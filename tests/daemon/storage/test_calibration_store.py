"""What is calibrated is in force whole or not at all, belongs to its station and probe, and outlives a bad file."""

import json
import os
import threading
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.storage.calibration_history import HISTORY_KEPT
from daemon.storage.calibration_records import Record
from daemon.storage.calibration_resume import Partial
from daemon.storage.calibration_store import Calibrations
from tests.daemon.tools.report.synthetic import backlash_record, map_record, rotation_record
from tests.vision.scene import Camera, Canvas, Needle, draw_needle, frame_of
from vision import ProbeModel

TIP_PX = (428.0, 620.0)
OF_ANOTHER: dict[str, dict[str, Any]] = {"station": {"station": "s2"}, "probe": {"probe": "another"}}


@pytest.fixture(scope="module")
def probe() -> ProbeModel:
    canvas = Canvas(TIP_PX, (500, 500), 20.0)
    draw_needle(canvas, Needle(tip=TIP_PX), True)
    frame = frame_of(canvas.develop(Camera(), np.random.default_rng(1)), canvas, True, 20.0)
    return ProbeModel.teach(frame, TIP_PX)


@pytest.fixture
def store(tmp_path: Path, probe: ProbeModel) -> Calibrations:
    calibrations = Calibrations(tmp_path, "s1")
    calibrations.store_probe(probe)
    return calibrations


def _again(store: Calibrations, station: str = "s1") -> Calibrations:
    calibrations = Calibrations(store.folder, station)
    calibrations.load()
    return calibrations


def _of(store: Calibrations, make: Callable[..., Record], **changes: Any) -> Record:
    """Return a record that fits the station and its probe, but for what is changed."""
    return make(**{"station": "s1", "probe": store.fingerprint} | changes)


def test_a_record_is_in_force_at_once_and_after_a_restart(store: Calibrations) -> None:
    assert store.store(_of(store, map_record)) is None
    assert store.store(_of(store, rotation_record)) is None
    assert store.pose_map is not None
    assert store.head is not None
    again = _again(store)
    assert again.made_at() == store.made_at()
    assert again.head is not None
    assert again.head.tip_offset_um(77.0) == pytest.approx(store.head.tip_offset_um(77.0))


def test_what_is_replaced_goes_to_the_history(store: Calibrations) -> None:
    first = _of(store, rotation_record)
    store.store(first)
    kept = store.store(_of(store, rotation_record, seed=2))
    assert kept is not None
    assert kept.parent.name == "history"
    assert kept.read_text() == first.model_dump_json(indent=1)


def test_of_records_replaced_in_the_same_moment_none_is_lost(
    store: Calibrations, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("daemon.storage.calibration_history.utc_now", lambda: "2026-03-04T05:06:07.000+00:00")
    records = [_of(store, backlash_record, seed=seed) for seed in range(12)]
    for record in records:
        store.store(record)
    kept = sorted((store.folder / "history").glob("backlash-*.json"))
    assert sorted(file.read_text() for file in kept) == sorted(r.model_dump_json(indent=1) for r in records[:-1])


def test_the_history_keeps_the_newest_and_no_more_than_its_number(store: Calibrations) -> None:
    records = [_of(store, backlash_record, seed=seed) for seed in range(HISTORY_KEPT + 4)]
    for record in records:
        store.store(record)
    kept = {file.read_text() for file in (store.folder / "history").glob("backlash-*.json")}
    assert kept == {record.model_dump_json(indent=1) for record in records[3:-1]}


def test_a_file_system_without_hard_links_keeps_a_copy(store: Calibrations) -> None:
    first = _of(store, backlash_record)
    store.store(first)
    refused = PermissionError(1, "Operation not permitted")
    with patch.object(os, "link", side_effect=refused):
        kept = store.store(_of(store, backlash_record, seed=2))
    assert kept is not None
    assert kept.read_text() == first.model_dump_json(indent=1)


def test_a_history_that_cannot_be_pruned_keeps_nothing_from_being_stored(store: Calibrations) -> None:
    for seed in range(HISTORY_KEPT + 1):
        store.store(_of(store, backlash_record, seed=seed))
    last = _of(store, backlash_record, seed=1000)
    with patch.object(os, "unlink", side_effect=PermissionError(13, "Permission denied")):
        store.store(last)
    assert store.records["backlash"] == _again(store).records["backlash"] == last


@pytest.mark.parametrize("damage", ["torn", "of another kind", "of another station", "of another probe"])
def test_what_does_not_fit_is_not_used_and_said(store: Calibrations, damage: str) -> None:
    changes = OF_ANOTHER.get(damage.removeprefix("of another "), {})
    text = _of(store, map_record, **changes).model_dump_json()
    if damage == "of another kind":
        text = _of(store, backlash_record).model_dump_json()
    store.file("map").write_text(text[:200] if damage == "torn" else text)
    again = _again(store)
    assert again.pose_map is None
    assert again.probe is not None
    with pytest.raises(Fault, match="has not been calibrated: ") as caught:
        again.require_map(30.0, 5200.0)
    assert caught.value.kind is FaultCode.NOT_CALIBRATED


@pytest.mark.parametrize(
    "name", ["map.json", "alignment.json", "alignment.void.json", "probe.npz", "rotation.partial.json"]
)
def test_a_pipe_in_the_place_of_a_calibration_is_not_waited_for(store: Calibrations, name: str) -> None:
    store.store(_of(store, backlash_record))
    (store.folder / name).unlink(missing_ok=True)
    os.mkfifo(store.folder / name)
    found: list[tuple[Calibrations, Partial | None]] = []
    reading = threading.Thread(target=lambda: found.append((_again(store), Partial.read(store.folder))), daemon=True)
    reading.start()
    reading.join(20.0)
    assert found, "it waits for somebody who writes into the pipe"
    assert found[0][1] is None
    assert (found[0][0].probe is None) is (name == "probe.npz")


def test_a_note_that_is_nested_too_deeply_voids_the_alignment_and_ends_nothing(store: Calibrations) -> None:
    (store.folder / "alignment.void.json").write_text("[" * 100_000)
    assert _again(store).problems["alignment"] == "whether it is void cannot be read"


@pytest.mark.parametrize("wrong", ["station", "probe", "map"])
def test_a_record_that_could_not_be_used_after_a_restart_is_refused_before_anything_is_written(
    store: Calibrations, wrong: str
) -> None:
    store.store(_of(store, map_record))
    before = {file: file.read_bytes() for file in store.folder.rglob("*") if file.is_file()}
    in_force = store.records["map"]
    record = _of(store, map_record, seed=2, **OF_ANOTHER.get(wrong, {}))
    if wrong == "map":
        record = record.model_copy(update={"pose_map": json.loads('{"format": "something else"}')})
    with pytest.raises(ValueError, match=r"another probe|made on station|not a pose map"):
        store.store(record)
    assert {file: file.read_bytes() for file in store.folder.rglob("*") if file.is_file()} == before
    assert store.records["map"] is in_force


def test_a_new_probe_makes_map_and_rotation_void(store: Calibrations, probe: ProbeModel) -> None:
    """Even if it looks exactly like the one before."""
    before = store.fingerprint
    for make in (map_record, rotation_record, backlash_record):
        store.store(_of(store, make))
    store.store_probe(probe)
    assert store.fingerprint != before
    assert store.pose_map is None
    assert store.head is None
    assert set(store.made_at()) == set(_again(store).made_at()) == {"backlash"}
    assert len(list((store.folder / "history").iterdir())) == 2
    assert not store.problems


def test_a_void_record_that_cannot_be_removed_is_not_used_all_the_same(store: Calibrations, probe: ProbeModel) -> None:
    store.store(_of(store, map_record))
    with patch.object(os, "unlink", side_effect=PermissionError(13, "Permission denied")):
        store.store_probe(probe)
    assert store.file("map").exists()
    again = _again(store)
    assert store.pose_map is again.pose_map is None
    assert store.problems == again.problems == {"map": "it was made with another probe"}


def test_what_was_read_once_does_not_change_when_more_is_stored(store: Calibrations, probe: ProbeModel) -> None:
    store.store(_of(store, map_record))
    seen, made_at, pose_map = store.in_force, store.made_at(), store.pose_map
    store.store(_of(store, rotation_record))
    store.store_probe(probe)
    assert (seen.made_at(), seen.pose_map, seen.head) == (made_at, pose_map, None)
    with pytest.raises(TypeError):
        seen.records["map"] = _of(store, map_record)  # type: ignore[index]


# --- a rotation that goes on ------------------------------------------------------------------------------------


def _partial(store: Calibrations, record: Any) -> Partial:
    return Partial(
        station="s1", probe=store.fingerprint, map_made_at="", control_um=record.control_um,
        angles=tuple(s.theta_deg for s in record.stops), card_height_um=0.0, stops=record.stops, sightings=(),
    )  # fmt: skip


def test_a_stored_rotation_ends_its_run(store: Calibrations) -> None:
    record = _of(store, rotation_record)
    _partial(store, record).write(store.folder)
    assert Partial.read(store.folder) is not None
    store.store(record)
    assert Partial.read(store.folder) is None
    assert not list(store.folder.glob("*partial*"))


def test_a_run_whose_file_cannot_be_removed_is_over_all_the_same(store: Calibrations) -> None:
    record = _of(store, rotation_record)
    _partial(store, record).write(store.folder)
    with patch.object(os, "unlink", side_effect=PermissionError(13, "Permission denied")):
        store.store(record)
    assert list(store.folder.glob("*partial*"))
    assert Partial.read(store.folder) is None


def test_a_rotation_that_could_not_be_stored_leaves_its_run_to_go_on(store: Calibrations) -> None:
    record = _of(store, rotation_record)
    _partial(store, record).write(store.folder)
    with (
        patch.object(os, "replace", side_effect=OSError(28, "No space left")),
        pytest.raises(OSError, match="No space"),
    ):
        store.store(record)
    assert Partial.read(store.folder) == _partial(store, record)


# --- what must be there -------------------------------------------------------------------------------------------

WORK_Z_UM = 5200.0
DAY_S = 86_400.0


def _mapped(store: Calibrations, age_s: float = 0.0) -> Calibrations:
    made_at = datetime.now(UTC) - timedelta(seconds=age_s)
    store.store(_of(store, map_record, made_at=made_at.isoformat(timespec="milliseconds")))
    return store


def _refused(ask: Callable[[], object]) -> Fault:
    with pytest.raises(Fault) as caught:
        ask()
    assert caught.value.kind is FaultCode.NOT_CALIBRATED
    return caught.value


def test_what_was_never_calibrated_is_asked_for_by_name(tmp_path: Path, store: Calibrations) -> None:
    assert "taught" in _refused(Calibrations(tmp_path / "none", "s1").require_probe).message
    assert store.require_probe() is store.probe
    assert "map" in _refused(lambda: store.require_map(1.0, WORK_Z_UM)).message


@pytest.mark.parametrize(("age_days", "good"), [(0.0, True), (1.99, True), (2.01, False)])
def test_a_map_is_good_for_its_days(store: Calibrations, age_days: float, *, good: bool) -> None:
    assert _mapped(store, age_days * DAY_S).pose_map is not None
    height_um = store.pose_map.work_z_um
    if good:
        assert store.require_map(2.0, height_um) is store.pose_map
    else:
        assert "2 days old" in _refused(lambda: store.require_map(2.0, height_um)).message


@pytest.mark.parametrize(("off_um", "good"), [(1.0, True), (-1.0, True), (1.5, False), (-1.5, False)])
def test_a_map_is_good_at_the_height_where_it_was_made(store: Calibrations, off_um: float, *, good: bool) -> None:
    made_um = _mapped(store).in_force.pose_map.work_z_um
    if good:
        assert store.require_map(2.0, made_um + off_um) is store.pose_map
    else:
        assert _refused(lambda: store.require_map(2.0, made_um + off_um)).detail["was"] == made_um
