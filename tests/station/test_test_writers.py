"""What people who write tests get of a whole simulated station: the pytest example, by one command."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.station.rig import ROOT


@pytest.mark.timeout(600)
def test_the_pytest_example_runs_on_a_simulated_station_that_it_starts_itself(tmp_path: Path) -> None:
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("PYTEST_", "REPROBE_"))}
    command = [sys.executable, "-m", "pytest", "-p", "daemon.adapters.pytest_plugin", "-p", "no:cacheprovider", "-rA",
               "--strict-markers", "--rootdir", str(tmp_path), "-c", os.devnull, "--basetemp", str(tmp_path / "run"),
               str(ROOT / "doc" / "examples" / "test_nets.py"), "--reprobe-sim"]  # fmt: skip
    settings = {**kept, "PYTHONPATH": str(ROOT), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    ran = subprocess.run(command, cwd=tmp_path, env=settings, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert "6 passed" in ran.stdout
    assert "test_every_net_of_the_plan_is_whole[TP5-continuity]" in ran.stdout
    truth = next(tmp_path.rglob("truth.jsonl")).read_text()
    assert truth.count('"touch_down"') >= 6
