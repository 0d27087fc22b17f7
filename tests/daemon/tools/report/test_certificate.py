"""The certificate says what is calibrated, with what, how well and until when; and any page is drawn again."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from daemon.cli.app import app
from daemon.config.model import load_config
from daemon.platform.clock import utc_now
from daemon.storage.calibration_in_force import InForce
from daemon.storage.calibration_records import Record
from daemon.tools.board_import import Options, import_board
from daemon.tools.demo.settings import Places, write_settings
from daemon.tools.report.certificate import certificate
from tests.daemon.tools.report.synthetic import (
    alignment_record,
    backlash_record,
    map_record,
    rotation_record,
    surface_record,
)

ROOT = Path(__file__).parents[4]
pytestmark = pytest.mark.usefixtures("logging_as_before")


def _records(made_at: str) -> dict[str, Record]:
    made = {"station": "demo", "made_at": made_at}
    records: list[Record] = [map_record(**made), rotation_record(**made), surface_record(**made),
                             backlash_record(**made), alignment_record(**made)]  # fmt: skip
    return {record.what: record for record in records}


def test_it_has_every_calibration_with_its_reference_and_the_error_budget(tmp_path: Path) -> None:
    config = load_config(write_settings(Places(tmp_path, tmp_path)))
    page = certificate(config, InForce("demo", fingerprint="abc", records=_records(utc_now())))
    labels = [number.label for number in page.numbers]
    for kind in ("map", "rotation", "surface", "backlash", "alignment"):
        assert {kind, f"{kind}: by"} <= set(labels)
    parts = [float(n.value) for n in page.numbers if n.label.startswith("error budget: ") and "together" not in n.label]
    (together,) = (float(n.value) for n in page.numbers if "together" in n.label)
    assert len(parts) >= 3
    assert together == pytest.approx(sum(part**2 for part in parts) ** 0.5)


@pytest.mark.parametrize(("made_at", "left_out", "why"), [
    ("2020-01-01T00:00:00.000+00:00", "", "Too old: map"), (utc_now(), "rotation", "Not calibrated"),
])  # fmt: skip
def test_what_is_missing_or_too_old_is_no_good(tmp_path: Path, made_at: str, left_out: str, why: str) -> None:
    config = load_config(write_settings(Places(tmp_path, tmp_path)))
    records = {kind: record for kind, record in _records(made_at).items() if kind != left_out}
    page = certificate(config, InForce("demo", records=records))
    assert not page.verdict.good
    assert page.verdict.because.startswith(why)


@pytest.mark.parametrize("left_out", [
    (), ("map", "surface"), ("rotation", "alignment"), ("map", "rotation", "surface", "backlash", "alignment"),
])  # fmt: skip
def test_what_is_not_measured_is_said_with_its_command_and_is_no_zero_in_the_sum(
    tmp_path: Path, left_out: tuple[str, ...]
) -> None:
    config = load_config(write_settings(Places(tmp_path, tmp_path)))
    records = {kind: record for kind, record in _records(utc_now()).items() if kind not in left_out}
    page = certificate(config, InForce("demo", records=records))
    for kind in left_out:
        (row,) = (number for number in page.numbers if number.label == kind)
        assert (row.text, row.bad) == ("not measured", True)
        assert ("`reprobe align`" if kind == "alignment" else f"`reprobe calibrate {kind}`") in row.limit
    budget = [number for number in page.numbers if number.label.startswith("error budget: ")]
    assert len(budget) == 4, "its lines are the same whatever was measured"
    unknown = [number for number in budget if number.text == "not measured"]
    assert len(unknown) == len({"rotation", "alignment", "backlash"} & set(left_out))
    assert all("measures it" in number.limit and number.bad for number in unknown)
    assert isinstance(budget[-1].value, str) == bool(unknown), "a sum without a part of it is none"
    assert page.verdict.good == (not left_out)


def test_the_command_writes_a_certificate_where_nothing_was_calibrated(tmp_path: Path) -> None:
    config, page = write_settings(Places(tmp_path, tmp_path)), tmp_path / "certificate.html"
    import_board(ROOT / "sim_hw" / "demo_board", "top", Options(bare=True)).save(load_config(config).board.file)
    written = CliRunner().invoke(app, ["calibrate", "certificate", "-c", str(config), "-o", str(page)])
    assert written.exit_code == 0, written.output
    assert "not measured" in page.read_text()
    assert "reprobe calibrate surface" in page.read_text()


def test_a_calibrations_page_is_drawn_again_by_its_name(tmp_path: Path) -> None:
    config = write_settings(Places(tmp_path, tmp_path))
    folder = tmp_path / "station/calibration"
    folder.mkdir(parents=True)
    (folder / "rotation.json").write_text(_records(utc_now())["rotation"].model_dump_json())
    page = tmp_path / "page.html"
    drawn = CliRunner().invoke(app, ["calibrate", "page", "rotation", "-c", str(config), "-o", str(page)])
    assert drawn.exit_code == 0, drawn.output
    text = page.read_text()
    assert "measured stop" in text
    assert "total error (eq. 6.8)" not in text
    none = CliRunner().invoke(app, ["calibrate", "page", "map", "-c", str(config), "-o", str(page)])
    assert none.exit_code == 2
    assert "no calibration" in none.output
