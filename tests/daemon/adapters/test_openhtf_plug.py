"""The OpenHTF plug, by its example, where OpenHTF is installed."""

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from tests.daemon.adapters.station import listed_station, reading, record

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize(
    ("told", "code", "outcome"),
    [
        (record("TP1"), 0, "PASS"),
        (record("TP1", "fail", readings=[reading(41.0)]), 1, "FAIL"),
        (record("TP1", "contact_not_made", reason="three touches"), 1, "ERROR"),
    ],
)
def test_the_example_measures_a_net(told: Mapping[str, Any], code: int, outcome: str, tmp_path: Path) -> None:
    pytest.importorskip("openhtf", reason="OpenHTF is not installed: pip install 'reprobe[openhtf]'")
    with listed_station(f"ipc://{tmp_path}/control", {"TP1": told}) as station:
        command = [sys.executable, str(ROOT / "doc" / "examples" / "openhtf_nets.py"), station.endpoint, "board-7"]
        paths = os.pathsep.join([str(ROOT), *filter(None, sys.path)])
        settings = {**os.environ, "PYTHONPATH": paths, "HOME": str(tmp_path)}
        ran = subprocess.run(command, capture_output=True, text=True, check=False, timeout=100, env=settings)
    assert ran.returncode == code, ran.stdout + ran.stderr
    assert outcome in ran.stdout
    assert station.asked[0]["board_id"] == "board-7"
