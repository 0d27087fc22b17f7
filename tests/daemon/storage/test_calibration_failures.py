"""Full disks and kills: at every step what a fresh process reads is wholly the old or wholly the new calibration."""

from __future__ import annotations

import itertools
import json
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon.storage.calibration_records import Record
from daemon.storage.calibration_store import Calibrations
from tests.daemon.storage.disk_steps import Steps, disk_full
from tests.daemon.tools.report.synthetic import backlash_record, map_record, rotation_record, surface_record
from tests.vision.scene import Camera, Canvas, Needle, draw_needle, frame_of
from vision import ProbeModel

ROOT = Path(__file__).parents[3]
STATION = "s1"
NEW: dict[str, Any] = {"made_at": "2026-05-04T07:00:00+00:00", "seed": 7}
LEAST_STEPS = 5
"""A new file opened and written, its flush, the rename, and the folder's flush."""
LITTLE_ROOM_BYTES = 200
STORED: dict[str, Callable[..., Any]] = {
    "map": map_record,
    "rotation": rotation_record,
    "surface": surface_record,
    "backlash": backlash_record,
}
"""Kinds of records."""
PROBES = {"same probe": 0, "other probe": 1}
"""A probe may be taught again from the same picture: what was calibrated before is void even so."""


Probes = tuple[ProbeModel, ProbeModel]


@pytest.fixture(scope="module")
def probes() -> Probes:
    return _taught((428.0, 620.0)), _taught((430.0, 619.0))


def _taught(tip_px: tuple[float, float]) -> ProbeModel:
    canvas = Canvas(tip_px, (500, 500), 20.0)
    draw_needle(canvas, Needle(tip=tip_px), True)
    return ProbeModel.teach(
        frame_of(canvas.develop(Camera(), np.random.default_rng(1)), canvas, True, 20.0), tip_px
    )  # fmt: skip


@pytest.fixture(scope="module")
def before(tmp_path_factory: pytest.TempPathFactory, probes: Probes) -> Path:
    """The folder of a station that has everything."""
    folder = tmp_path_factory.mktemp("before")
    calibrations = Calibrations(folder, STATION)
    calibrations.store_probe(probes[0])
    for make in STORED.values():
        calibrations.store(make(station=STATION, probe=calibrations.fingerprint))
    return folder


def _loaded(folder: Path) -> Calibrations:
    calibrations = Calibrations(folder, STATION)
    calibrations.load()
    return calibrations


def _facts(calibrations: Calibrations) -> dict[str, Any]:
    """Return all that is worked with, so that two states can be compared."""
    probe, pose_map, head, surface = (
        getattr(calibrations, name) for name in ("probe", "pose_map", "head", "surface")
    )  # fmt: skip
    return {
        "tip": probe and probe.tip_px,
        "map": pose_map and pose_map.to_json(),
        "head": head and tuple(head.tip_offset_um(77.0)),
        "surface": surface and surface.to_dict(),
        "records": dict(calibrations.records),
    }


def _new(kind: str, calibrations: Calibrations, probes: Probes) -> Record | ProbeModel:
    """Return what is stored in a test."""
    if kind in PROBES:
        return probes[PROBES[kind]]
    record: Record = STORED[kind](station=STATION, probe=calibrations.fingerprint, **NEW)
    return record


def _store(calibrations: Calibrations, new: Record | ProbeModel) -> None:
    if isinstance(new, ProbeModel):
        calibrations.store_probe(new)
    else:
        calibrations.store(new)


def _goal(folder: Path, tmp_path: Path, kind: str, probes: Probes) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the facts before and after, when nothing disturbs."""
    shutil.copytree(folder, tmp_path / "undisturbed")
    calibrations = _loaded(tmp_path / "undisturbed")
    old = _facts(calibrations)
    _store(calibrations, _new(kind, calibrations, probes))
    new = _facts(_loaded(tmp_path / "undisturbed"))
    assert old != new
    return old, new


@pytest.mark.parametrize("kind", [*STORED, *PROBES])
def test_a_disk_that_is_full_at_any_step_leaves_memory_and_disk_the_same(
    before: Path, tmp_path: Path, probes: Probes, kind: str
) -> None:
    """And what raises has left the old calibration; once the new one is in force nothing raises any more."""
    _fill_the_disk_at_every_step(before, tmp_path, kind, probes)


def test_a_disk_that_is_full_at_any_step_of_the_first_calibration_leaves_none(tmp_path: Path, probes: Probes) -> None:
    (tmp_path / "empty").mkdir()
    _fill_the_disk_at_every_step(tmp_path / "empty", tmp_path, "backlash", probes)


def _fill_the_disk_at_every_step(before: Path, tmp_path: Path, kind: str, probes: Probes) -> None:
    old, new = _goal(before, tmp_path, kind, probes)
    ends = []
    for at in itertools.count(1):
        folder = tmp_path / f"full-{at}" / "calibration"
        shutil.copytree(before, folder)
        calibrations, steps = _loaded(folder), Steps(at, disk_full)
        record = _new(kind, calibrations, probes)
        raised = False
        with steps.watched():
            try:
                _store(calibrations, record)
            except OSError:
                raised = True
        memory = _facts(calibrations)
        assert memory == _facts(_loaded(folder)), f"after a failing {steps.taken[-1]}, step {at}"
        assert memory == (old if raised else new), f"after a failing {steps.taken[-1]}, step {at}"
        if not steps.reached:
            break
        ends.append(raised)
    assert len(ends) >= LEAST_STEPS
    assert ends[0], "the first step fails the whole"


@pytest.mark.parametrize("kind", [*STORED, *PROBES])
def test_a_file_that_can_be_written_in_part_only_leaves_the_old_calibration(
    before: Path, tmp_path: Path, probes: Probes, kind: str
) -> None:
    """The system itself refuses the rest, as on a disk with little room."""
    folder = tmp_path / "calibration"
    shutil.copytree(before, folder)
    calibrations = _loaded(folder)
    old, record = _facts(calibrations), _new(kind, calibrations, probes)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (LITTLE_ROOM_BYTES, limits[1]))
    try:
        with pytest.raises(OSError, match="File too large"):
            _store(calibrations, record)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert _facts(calibrations) == _facts(_loaded(folder)) == old
    assert not list(folder.glob(".new-*"))


@pytest.mark.parametrize("kind", [*STORED, *PROBES])
def test_a_process_killed_before_any_step_leaves_the_old_or_the_new_calibration(
    before: Path, tmp_path: Path, probes: Probes, kind: str
) -> None:
    old, new = _goal(before, tmp_path, kind, probes)
    shutil.copytree(before, tmp_path / "before")
    new_one = _new(kind, _loaded(before), probes)
    if isinstance(new_one, ProbeModel):
        new_one.save(tmp_path / "probe.npz")
    else:
        (tmp_path / "record.json").write_text(new_one.model_dump_json())
    steps = json.loads(_run_killed_writer(tmp_path))
    assert len(steps) >= LEAST_STEPS
    left = [_facts(_loaded(tmp_path / f"after-{at}")) for at in range(1, len(steps) + 2)]
    which = ["old" if facts == old else "new" if facts == new else "neither" for facts in left]
    turned = which.index("new")
    assert which == ["old"] * turned + ["new"] * (len(which) - turned), list(zip(steps, which, strict=False))
    assert turned > 0


@pytest.mark.parametrize("kind", ["map", "other probe"])
def test_after_a_kill_the_next_calibration_is_stored_as_ever(
    before: Path, tmp_path: Path, probes: Probes, kind: str
) -> None:
    """And what the killed one had begun to keep is not kept twice."""
    shutil.copytree(before, tmp_path / "before")
    (tmp_path / "record.json").write_text(_killed_record(before))
    steps = json.loads(_run_killed_writer(tmp_path))
    for at in range(1, len(steps) + 1):
        folder = tmp_path / f"after-{at}"
        calibrations = _loaded(folder)
        _store(calibrations, _new(kind, calibrations, probes))
        assert _facts(calibrations) == _facts(_loaded(folder))
        kept = [file.read_bytes() for file in (folder / "history").glob("map-*.json")]
        assert len(kept) == len(set(kept)), f"killed before {steps[at - 1]}, step {at}"


def _killed_record(before: Path) -> str:
    """Return a map that never comes into force, or does so just before its writer is killed."""
    return map_record(station=STATION, probe=_loaded(before).fingerprint, job="killed", seed=9).model_dump_json()


def _run_killed_writer(folder: Path) -> str:
    command = [sys.executable, "-m", "tests.daemon.storage.killed_writer", str(folder), STATION]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout
