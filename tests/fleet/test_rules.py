"""Rules of Prometheus fire on what they are for, judged by Prometheus' own tool; they name figures that exist."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from prometheus_client import CollectorRegistry, generate_latest

from daemon.fleet.counts import Counts
from daemon.telemetry.metrics import Metrics
from daemon.telemetry.vitals import Vitals
from tests.packages import not_installed

VITALS = Vitals("not_homed", 0, 9, 4096, {"map": 60.0}, {}, {})
HERE = Path(__file__).parent
RULES = HERE.parents[1] / "systemd" / "prometheus-rules.yml"


def test_each_alert_fires_on_what_it_is_for_and_is_silent_on_a_healthy_fleet() -> None:
    tool = shutil.which("promtool")
    assert tool is not None, not_installed("prometheus")
    done = subprocess.run(
        [tool, "test", "rules", str(HERE / "prometheus-rules.test.yml")], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize(("name", "agent"), [("prometheus.yml", ()), ("prometheus-agent.yml", ("--agent",))])
def test_the_shipped_configurations_of_prometheus_are_read(name: str, agent: tuple[str, ...]) -> None:
    words = ["promtool", "check", "config", "--syntax-only", *agent, str(RULES.with_name(name))]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def _families(registry: CollectorRegistry) -> set[str]:
    return set(re.findall(r"^# TYPE (\w+) ", generate_latest(registry).decode(), re.MULTILINE))


def test_every_figure_a_rule_names_is_one_that_daemon_or_collector_has() -> None:
    named = set(re.findall(r"(?<![:\w])reprobe_\w+", RULES.read_text()))
    daemon = Metrics("s", "1")
    daemon.watch(lambda: VITALS)
    there = _families(daemon.registry) | _families(Counts().registry)
    assert named
    assert {re.sub("_(sum|count|bucket)$", "", name) for name in named} <= there
