"""The command writes a page or says in one line why not; matplotlib stays in its process."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from daemon.tools.report.__main__ import main
from tests.daemon.tools.report.synthetic import backlash_record, map_record

ROOT = Path(__file__).parents[4]
LOADED = "daemon.app.service, daemon.cli, daemon.tools.report.index"


def _record(folder: Path, name: str = "now.json", **changes: object) -> Path:
    path = folder / name
    path.write_text(backlash_record(**changes).model_dump_json())  # type: ignore[arg-type]
    return path


def _refused(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str]:
    """Run the command; return its exit status and the one line it said."""
    try:
        status = main([str(a) for a in arguments])
    except SystemExit as leave:
        status = int(str(leave.code))
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    return status, err


def test_a_page_and_the_index_beside_it_are_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "reports" / "play.html"
    now, before = _record(tmp_path, play_um=20.0), _record(tmp_path, "before.json")
    assert main([str(now), "--previous", str(before), "-o", str(out)]) == 0
    assert "play changed by" in out.read_text()
    assert 'href="play.html"' in (out.parent / "index.html").read_text()
    assert sorted(path.name for path in out.parent.iterdir()) == ["index.html", "play.html"]
    assert capsys.readouterr() == ("", "")


def test_others_may_read_a_page(tmp_path: Path) -> None:
    out = tmp_path / "play.html"
    assert main([str(_record(tmp_path)), "-o", str(out)]) == 0
    assert out.stat().st_mode & 0o777 == 0o644


@pytest.mark.parametrize("text", ["", "{", "[]", '{"what": "map"}', '{"what": "weather"}', "\x00"])
def test_what_is_no_record_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str
) -> None:
    bad, out = tmp_path / "bad.json", tmp_path / "reports" / "page.html"
    bad.write_text(text)
    status, line = _refused(capsys, bad, "-o", out)
    assert status == 2
    assert "bad.json is no calibration of this program" in line
    assert not out.parent.exists()


def test_a_previous_record_of_another_kind_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = tmp_path / "map.json"
    other.write_text(map_record().model_dump_json())
    status, line = _refused(capsys, _record(tmp_path), "--previous", other, "-o", tmp_path / "page.html")
    assert status == 2
    assert "of a map, this one of a backlash" in line
    assert not (tmp_path / "page.html").exists()


def test_a_page_that_was_there_survives_a_failure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "page.html"
    out.write_text("as it was")
    status, _ = _refused(capsys, _record(tmp_path, made_at="soon"), "-o", out)
    assert status == 2
    assert out.read_text() == "as it was"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["now.json", "page.html"]


def test_a_missing_record_and_a_place_that_cannot_be_written_are_files_faults(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, line = _refused(capsys, tmp_path / "none.json", "-o", tmp_path / "page.html")
    assert status == 1
    assert "none.json" in line
    (tmp_path / "file").write_text("")
    status, line = _refused(capsys, _record(tmp_path), "-o", tmp_path / "file" / "page.html")
    assert status == 1
    assert "file" in line


def test_the_index_is_no_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, line = _refused(capsys, _record(tmp_path), "-o", tmp_path / "index.html")
    assert status == 2
    assert "name the page otherwise" in line


def test_a_call_without_a_page_is_refused_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, line = _refused(capsys, _record(tmp_path))
    assert status == 2
    assert "--output" in line


def _run(*arguments: object, **settings: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *map(str, arguments)], cwd=ROOT, capture_output=True, text=True, check=False, env=settings
    )


def test_the_command_runs_without_a_home_and_says_nothing_when_all_is_well(tmp_path: Path) -> None:
    out = tmp_path / "page.html"
    run = _run("-m", "daemon.tools.report", _record(tmp_path), "-o", out, HOME="/nonexistent", TMPDIR=str(tmp_path))
    assert (run.returncode, run.stdout, run.stderr) == (0, "", "")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["index.html", "now.json", "page.html"]


def test_the_service_never_imports_matplotlib() -> None:
    run = _run(
        "-c",
        "import sys, daemon.app.service, daemon.cli, daemon.tools.report.index; print('matplotlib' in sys.modules)",
    )
    assert (run.stdout.strip(), run.returncode) == ("False", 0), run.stderr
