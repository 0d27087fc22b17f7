"""`make test` prints a line whenever a file is done, failures as they come, and one plain summary."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.shares import FEW_FILES, STATION, Share, shares, summary, unsteady_perhaps

ROOT = Path(__file__).parents[2]


def _share(text: str) -> Share:
    program = f"print({text!r})"
    share = Share("x", subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True))
    share.listen()
    share.process.wait()
    assert share.process.stdout is not None
    share.process.stdout.close()
    return share


def test_the_summary_counts_all_shares_and_names_what_failed() -> None:
    good = _share("tests/a.py ....\n=== 4 passed, 1 skipped in 2.00s ===")
    bad = _share("FAILED tests/b.py::test_x - assert 0\n=== 1 failed, 2 passed in 3.00s ===")
    said = summary([good, bad], [0, 1], 90.0)
    assert "6 tests passed, 1 failed, 1 skipped, in 1.5 minutes" in said
    assert "failed: tests/b.py::test_x - assert 0" in said
    assert said.endswith("not all is well")
    assert summary([good], [0], 1.0).endswith("\nall is well")


def test_a_run_of_few_words_is_counted_too_and_one_of_no_test_is_not_well() -> None:
    assert "2 tests passed" in summary([_share("..\n2 passed, 4208 deselected in 19.30s")], [0], 1.0)
    assert summary([_share("4208 deselected in 1.00s")], [5], 1.0).endswith("no test was run")


def test_a_share_that_was_cut_off_is_never_well() -> None:
    assert "'x' did not come to its end" in summary([_share("")], [-9], 1.0)


def test_few_files_with_a_failure_run_once_more_and_how_that_ended_is_told() -> None:
    bad = _share(
        "FAILED tests/b.py::test_x[a - b] - assert 0\nFAILED tests/b.py::test_y (setup)\n=== 2 failed in 3.00s ==="
    )
    assert unsteady_perhaps([bad], [1]) == ["tests/b.py"]
    assert summary([bad], [1], 1.0, 0).endswith("not all is well: what failed passed alone")
    assert summary([bad], [1], 1.0, 1).endswith("not all is well: what failed failed again alone")


def test_many_files_with_a_failure_or_a_share_that_was_cut_off_are_no_chance() -> None:
    many = _share("\n".join(f"FAILED tests/{n}.py::test_x - assert 0" for n in range(FEW_FILES + 1)))
    assert unsteady_perhaps([many], [1]) == []
    assert unsteady_perhaps([_share("FAILED tests/b.py::test_x - assert 0")], [-9]) == []
    assert unsteady_perhaps([_share("1 passed in 1.00s")], [0]) == []


def test_every_file_of_a_station_is_in_one_share(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    given = [word for words in shares().values() for word in words if word.startswith(f"{STATION}/")]
    assert sorted(given) == sorted(path.as_posix() for path in Path(STATION).glob("test_*.py"))
    assert f"--ignore={STATION}" in shares()["wired"]


def test_a_failure_is_told_before_the_next_test_runs(tmp_path: Path) -> None:
    (tmp_path / "test_two.py").write_text(
        "def test_bad():\n    assert 1 == 2\n\ndef test_then(capsys):\n"
        "    with capsys.disabled():\n        print('the next one runs', flush=True)\n"
    )
    said = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "tests.failures_at_once", "-p", "no:cacheprovider",
         "-c", str(ROOT / "pyproject.toml"), str(tmp_path / "test_two.py")],
        cwd=ROOT, capture_output=True, text=True, check=False,
    ).stdout  # fmt: skip
    assert said.index("FAILED") < said.index("assert 1 == 2") < said.index("the next one runs")
