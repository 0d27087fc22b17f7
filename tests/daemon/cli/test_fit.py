"""`fit`: a rotational record in, the thesis' figures out; a bad file is refused with its line, exit 2."""

import json
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner, Result

from daemon.cli.fit import fit, head_facts
from daemon.tools.rotation_csv import BadRecord, parse_record, read_record
from tests.vision.head_records import rebuilt_record

app = typer.Typer()
app.command()(fit)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Appendix D as rebuilt from the project's residuals, in a file."""
    path = tmp_path / "record.csv"
    np.savetxt(path, rebuilt_record(), delimiter=",", header="theta_deg,x_um,y_um", comments="", fmt="%.2f")
    return path


def _fit(*words: str | Path) -> Result:
    result = CliRunner().invoke(app, [str(word) for word in words], env={"COLUMNS": "130"})
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result


def test_the_whole_record_prints_the_thesis_figures(file: Path) -> None:
    result = _fit(file)
    assert result.exit_code == 0
    for figure in (
        "364275.3, 313843.1",
        "14938.2",
        "42.3 um",
        "116.8 um",
        "363.3 max",
        "91.6%",
        "25.3",
        "16.0",
        "13.4",
    ):
        assert figure in result.stdout


def test_every_15_fits_22_rows_and_judges_on_298(file: Path) -> None:
    facts = json.loads(_fit(file, "--every", "15", "--json").stdout)
    assert (facts["rows"], facts["fitted_rows"], facts["others"]["rows"]) == (320, 22, 298)
    assert facts["others"]["rms_um"] <= 20.0
    assert facts["others"]["max_um"] <= 70.0
    assert facts["repeatability_um"] is None
    assert "the other 298 angles" in _fit(file, "--every", "15").stdout


@pytest.mark.parametrize("model", ["circle", "fourier", "array"])
def test_the_model_asked_for_is_the_model_given(file: Path, model: str) -> None:
    facts = json.loads(_fit(file, "--model", model, "--json").stdout)
    assert facts["model"]["kind"] == model
    assert facts["others"] is None


def test_outliers_are_named(file: Path) -> None:
    lines = file.read_text().splitlines()
    theta, x_um, y_um = lines[1 + 30].split(",")
    lines[1 + 30] = f"{theta},{float(x_um) + 900.0},{y_um}"
    file.write_text("\n".join(lines))
    assert json.loads(_fit(file, "--json").stdout)["model"]["outliers_deg"] == [30.0]
    assert "30 deg, left out" in _fit(file).stdout


ROW = "0,1,2"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "the record is empty"),
        ("\n# only a remark\n", "the record is empty"),
        ("theta_deg,x_um,y_um\n", "a header and no rows"),
        ("theta_deg,x_um\n0,1\n", "line 1: no column y_um"),
        ("0,1,2\n1,2,3\n", "line 1: no column theta_deg"),
        ("theta_deg,x_um,y_um,x_um\n0,1,2,3\n", "line 1: the column x_um is there twice"),
        (f"theta_deg,x_um,y_um\n{ROW}\n1,,3\n", "line 3: x_um is empty"),
        (f"theta_deg,x_um,y_um\n{ROW}\n1,3\n", "line 3: 2 cells where 3 belong"),
        (f"theta_deg,x_um,y_um\n{ROW}\n1,2,3,4\n", "line 3: 4 cells where 3 belong"),
        (f"theta_deg,x_um,y_um\n{ROW}\n\n1,two,3\n", "line 4: x_um is 'two'"),
        (f"theta_deg,x_um,y_um\n{ROW}\n1,[red],3\n", "line 3: x_um is '[red]'"),
        (f"theta_deg,x_um,y_um\n{ROW}\n1,2,nan\n", "line 3: y_um is nan"),
        (f"theta_deg,x_um,y_um\n{ROW}\n1,-inf,2\n", "line 3: x_um is -inf"),
        (f"theta_deg,x_um,y_um\n{ROW}\n1,2,3\n360.0,2,3\n", "line 4: the angle 360 deg is in line 2 as well"),
        (f"theta_deg,x_um,y_um\n{ROW}\n359.995,2,3\n", "line 3: the angle 359.995 deg is in line 2 as well"),
        ("theta_deg,x_um,y_um\n" + "\n".join(f"{t},{t},1" for t in range(5)), "5 rows; record at least 6"),
        ("theta_deg,x_um,y_um\n" + "\n".join(f"{t},{t},1" for t in range(100, 140, 5)), "forbidden band"),
        ("theta_deg,x_um,y_um\n" + "\n".join(f"{t},5,5" for t in range(140, 440, 20)), "no circle is to be seen"),
    ],
)
def test_a_record_that_is_none_ends_with_a_sentence_and_exit_2(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    result = _fit(path)
    assert result.exit_code == 2
    assert says in " ".join(result.stderr.split())
    assert "->" in result.stderr
    assert not result.stdout


def test_a_file_that_cannot_be_read_ends_with_exit_2(tmp_path: Path) -> None:
    (tmp_path / "picture.csv").write_bytes(b"\x89PNG\xff\xfe\x00")
    for path, says in (
        (tmp_path / "none.csv", "No such file"),
        (tmp_path, "directory"),
        (tmp_path / "picture.csv", "not a text"),
    ):
        result = _fit(path)
        assert result.exit_code == 2
        assert says in result.stderr


def test_every_keeps_too_few_rows_is_refused(file: Path) -> None:
    result = _fit(file, "--every", "100")
    assert result.exit_code == 2
    assert "4 rows; record at least 6" in result.stderr


def test_columns_may_stand_in_any_order_beside_others_with_a_mark_at_the_head(tmp_path: Path) -> None:
    path = tmp_path / "record.csv"
    path.write_text("\ufeff# station 7\ny_um, note, theta_deg, x_um\n2, a, 0, 1\n4, b, 10, 3\n", encoding="utf-8")
    record = read_record(path)
    assert (record.theta_deg.tolist(), record.x_um.tolist(), record.y_um.tolist()) == ([0, 10], [1, 3], [2, 4])


def test_a_record_goes_through_text_unchanged() -> None:
    rows = rebuilt_record()
    record = parse_record(["theta_deg,x_um,y_um", *(",".join(map(repr, map(float, row))) for row in rows)])
    assert (np.column_stack([record.theta_deg, record.x_um, record.y_um]) == rows).all()
    assert head_facts(record)["circle"]["rms_um"] == pytest.approx(42.3, abs=0.05)


def test_a_bad_record_is_a_value_error_with_advice() -> None:
    with pytest.raises(BadRecord, match="empty") as caught:
        parse_record([])
    assert isinstance(caught.value, ValueError)
    assert "theta_deg" in caught.value.advice
