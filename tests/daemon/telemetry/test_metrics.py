"""Metrics say what was journalled, under names that Prometheus' rules ask for, and never hold up the daemon."""

from __future__ import annotations

import re
import socket
from collections.abc import Iterator
from typing import Any
from urllib.request import urlopen

import pytest
from prometheus_client.parser import text_string_to_metric_families

from daemon.telemetry.metrics import Metrics
from daemon.telemetry.vitals import Vitals

BUS = {"requests": 7, "timeouts": 1, "garbled": 2, "refused": 0, "retries": 3, "reconnects": 0, "connected": 1}
VITALS = Vitals("not_homed", 2, 9, 4096, {"map": 60.0}, {"main": BUS}, {"grabbed": 5, "late": 1, "missed": 0})
RESULT: dict[str, Any] = {
    "op": "correct",
    "outcome": "corrected",
    "error": None,
    "looks": 3,
    "moves": 2,
    "error_before_um": 120.0,
    "error_after_um": 8.0,
    "timing_ms": {"look": {"bus": 20.0, "software": 30.0, "total": 50.0}, "move": {"motion": 400.0, "total": 410.0}},
}
UNITS = ("_total", "_seconds", "_bytes", "_meters", "_info")


@pytest.fixture
def metrics() -> Iterator[Metrics]:
    made = Metrics("bench 1", "1.2.3")
    made.watch(lambda: VITALS)
    yield made
    made.close()


def _values(metrics: Metrics) -> dict[tuple[str, frozenset[tuple[str, str]]], float]:
    families = text_string_to_metric_families(metrics.text())
    return {(s.name, frozenset(s.labels.items())): s.value for family in families for s in family.samples}


def _value(metrics: Metrics, name: str, **labels: str) -> float:
    return _values(metrics)[name, frozenset(labels.items())]


def test_a_result_is_counted_with_its_times_and_errors(metrics: Metrics) -> None:
    metrics.take("result", RESULT)
    assert _value(metrics, "reprobe_jobs_total", op="correct", outcome="corrected") == 1
    assert _value(metrics, "reprobe_job_duration_seconds_sum", op="correct") == pytest.approx(0.46)
    spent = {"op": "correct", "state": "move", "wait": "motion"}
    assert _value(metrics, "reprobe_job_spent_seconds_sum", **spent) == pytest.approx(0.4)
    assert _value(metrics, "reprobe_correction_moves_sum") == 2
    assert _value(metrics, "reprobe_correction_error_before_meters_sum") == pytest.approx(120e-6)
    assert _value(metrics, "reprobe_correction_error_after_meters_bucket", le="1e-05") == 1


def test_a_failed_job_is_counted_by_its_error_and_has_no_error_in_metres(metrics: Metrics) -> None:
    failed = {**RESULT, "outcome": "failed", "error": {"name": "tip_not_found"}}
    metrics.take("result", {**failed, "error_before_um": None, "error_after_um": None})
    assert _value(metrics, "reprobe_job_errors_total", op="correct", error="tip_not_found") == 1
    assert _value(metrics, "reprobe_correction_error_before_meters_count") == 0


def test_exactly_one_state_is_on(metrics: Metrics) -> None:
    assert _value(metrics, "reprobe_state", state="fault") == 1
    metrics.take("state", {"state": "look"})
    states = {dict(labels)["state"]: v for (name, labels), v in _values(metrics).items() if name == "reprobe_state"}
    assert [state for state, on in states.items() if on] == ["look"]
    assert len(states) == 6


def test_an_alert_is_on_until_it_is_cleared(metrics: Metrics) -> None:
    metrics.take("alert", {"name": "tip_wear", "raised": True})
    assert _value(metrics, "reprobe_alert_active", alert="tip_wear") == 1
    metrics.take("alert", {"name": "tip_wear", "raised": False})
    assert _value(metrics, "reprobe_alert_active", alert="tip_wear") == 0


def test_reports_and_present_numbers_are_shown(metrics: Metrics) -> None:
    metrics.report("open", 20)
    metrics.report(None, 5)
    assert _value(metrics, "reprobe_touches_total") == 25
    assert _value(metrics, "reprobe_retests_total", result="open") == 1
    assert _value(metrics, "reprobe_fault", fault="not_homed") == 1
    assert _value(metrics, "reprobe_bus_garbled_total", bus="main") == 2
    assert _value(metrics, "reprobe_camera_late_total") == 1
    assert _value(metrics, "reprobe_calibration_age_seconds", what="map") == 60
    assert _value(metrics, "process_resident_memory_bytes") > 0


def test_names_follow_prometheus_rules(metrics: Metrics) -> None:
    metrics.take("result", RESULT)
    without_unit = {"reprobe_state", "reprobe_fault", "reprobe_alert_active", "reprobe_jobs_waiting",
                    "reprobe_threads", "reprobe_bus_connected", "reprobe_correction_looks",
                    "reprobe_correction_moves"}  # fmt: skip
    for line in metrics.text().splitlines():
        kind = re.fullmatch(r"# TYPE (reprobe\w*) (\w+)", line)
        if kind and not kind[1].endswith("_created"):
            assert kind[1] in without_unit or kind[1].endswith(UNITS), line
            assert kind[2] != "counter" or kind[1].endswith("_total"), line


def test_it_is_served_on_loopback_and_a_reader_that_says_nothing_holds_up_nobody(metrics: Metrics) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    assert metrics.address is None
    metrics.serve(port)
    with socket.create_connection(("127.0.0.1", port)), urlopen(f"http://127.0.0.1:{port}/metrics") as answer:
        assert b'reprobe_info{station="bench 1",version="1.2.3"} 1.0' in answer.read()
    assert metrics.address == ("127.0.0.1", port)
    metrics.close()
    assert metrics.address is None


def test_a_port_that_is_taken_is_an_os_error(metrics: Metrics) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken, pytest.raises(OSError, match="in use"):
        metrics.serve(taken.getsockname()[1])
