"""What is calibrated is in force whole or not at all, belongs to its station and probe, and outlives a bad file."""

from pathlib import Path

import numpy as np
import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.storage.calibration_store import Calibrations
from tests.daemon.tools.report.synthetic import map_record, rotation_record
from tests.vision.scene import Camera, Canvas, Needle, draw_needle, frame_of
from vision import ProbeModel

TIP_PX = (428.0, 620.0)


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


def test_a_record_is_in_force_at_once_and_after_a_restart(store: Calibrations) -> None:
    assert store.store(map_record(station="s1", probe=store.fingerprint)) is None
    assert store.store(rotation_record(station="s1", probe=store.fingerprint)) is None
    assert store.pose_map is not None
    assert store.head is not None
    again = _again(store)
    assert again.made_at() == store.made_at()
    assert again.head is not None
    assert again.head.tip_offset_um(77.0) == pytest.approx(store.head.tip_offset_um(77.0))


def test_what_is_replaced_goes_to_the_history(store: Calibrations) -> None:
    first = rotation_record(station="s1", probe=store.fingerprint)
    store.store(first)
    kept = store.store(rotation_record(station="s1", probe=store.fingerprint))
    assert kept is not None
    assert kept.parent.name == "history"
    assert kept.read_text() == first.model_dump_json(indent=1)


@pytest.mark.parametrize("damage", ["torn", "other station", "other probe"])
def test_what_does_not_fit_is_not_used_and_said(store: Calibrations, damage: str) -> None:
    station = "s2" if damage == "other station" else "s1"
    store.store(map_record(station=station, probe="another" if damage == "other probe" else store.fingerprint))
    if damage == "torn":
        file = store.file("map")
        file.write_text(file.read_text()[:200])
    again = _again(store)
    assert again.pose_map is None
    assert again.probe is not None
    with pytest.raises(Fault, match="has not been calibrated: ") as caught:
        again.require_map(30.0, 5200.0)
    assert caught.value.kind is FaultCode.NOT_CALIBRATED


def test_a_new_needle_makes_map_and_rotation_void(store: Calibrations, probe: ProbeModel) -> None:
    store.store(map_record(station="s1", probe=store.fingerprint))
    store.store(rotation_record(station="s1", probe=store.fingerprint))
    store.store_probe(probe)
    assert store.pose_map is None
    assert store.head is None
    assert not _again(store).made_at()
    assert len(list((store.folder / "history").iterdir())) == 2
