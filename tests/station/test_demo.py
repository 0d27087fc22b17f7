"""The demonstration tells its story: nets tested by the meter alone, and every answer is true by the log."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from daemon.config.sections.motion import ServoSection
from daemon.tools.demo.session import LIMIT_UM

NETS = 21
TOLERANCE_UM = ServoSection().tolerance_um
RUNS_S = 900.0
pytestmark = pytest.mark.timeout(int(RUNS_S) + 60)


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("demo") / "out"


@pytest.fixture(scope="module")
def ended(out: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "daemon.cli", "demo", "-o", str(out), "--json"]
    return subprocess.run(command, capture_output=True, text=True, timeout=RUNS_S, check=False)


@pytest.fixture(scope="module")
def told(ended: subprocess.CompletedProcess[str]) -> dict[str, Any]:
    story: dict[str, Any] = json.loads(ended.stdout)
    return story


def test_every_net_is_answered_and_every_answer_is_true(
    ended: subprocess.CompletedProcess[str], told: dict[str, Any]
) -> None:
    assert ended.returncode == 0, ended.stderr
    assert told["good"]
    assert (len(told["points"]), told["scratches"], told["dents"]) == (NETS, 0, 0)
    assert [point["wrong"] for point in told["points"]] == [None] * NETS
    for point in told["points"]:
        assert (point["verdict"] == "open_confirmed") is not point["sound"]


def test_first_touches_fail_for_more_than_one_reason_and_each_is_cured_by_what_it_takes(told: dict[str, Any]) -> None:
    looked = [point for point in told["points"] if point["recovered_by"] == "look"]
    by_eye = [point for point in looked if point["cause"] == "misplaced"]
    assert by_eye
    assert any(not point["sound"] for point in told["points"]), "no net of the board is broken"
    assert f"{NETS} nets: " in told["sentence"]
    assert f"{len(by_eye)} by eye" in told["sentence"]


def test_a_recovered_point_has_pictures_of_the_miss_and_of_the_hit(
    ended: subprocess.CompletedProcess[str], told: dict[str, Any], out: Path
) -> None:
    """Of a first look that was refused there is none: what could not be seen is not drawn.

    A film that the second press broke may leave one picture: a look that sees the tip in place moves nothing.
    """
    page = (out / "index.html").read_text()
    recovered = [point for point in told["points"] if point["recovered_by"] == "look"]
    assert recovered, ended.stderr
    both = 0
    for point in recovered:
        folder = Path(point["pictures"])
        kept = [name for name in ("before-landing.jpg", "after-landing.jpg") if (folder / name).is_file()]
        in_place = point["cause"] == "film" and point["error_um"] <= TOLERANCE_UM
        assert ("before-landing.jpg" if in_place else "after-landing.jpg") in kept, point
        for name in kept:
            assert (folder / name).stat().st_size > 10_000
            assert f"{folder.name}/{name}" in page
        both += len(kept) == 2 and point["cause"] == "misplaced"
    assert both


def test_progress_is_told_where_nobody_watches_a_bar(ended: subprocess.CompletedProcess[str]) -> None:
    assert f"{NETS}/{NETS} " in ended.stderr
    assert "the board lies" in ended.stderr
    shown = re.search(r"the needle was (\d+) um off, and is (\d+) um off now", ended.stderr)
    assert shown, ended.stderr
    assert int(shown[2]) <= min(int(shown[1]), LIMIT_UM), "the first landing is seen before the long calibrations"
    assert ended.stderr.index(shown[0]) < ended.stderr.index("calibrating the rotation")
