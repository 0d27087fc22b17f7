"""Prometheus metrics: counted when something is published, read when somebody scrapes.

Names follow Prometheus: base units (seconds, metres, bytes) in the name, `_total` on counters. Every daemon has a
registry of its own. It is served on loopback by threads of their own, so a slow reader never holds up the event loop;
what those threads read of the daemon are plain numbers.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final
from wsgiref.simple_server import WSGIServer

from prometheus_client import (
    CollectorRegistry,
    Counter,
    Gauge,
    Histogram,
    Info,
    ProcessCollector,
    generate_latest,
    start_http_server,
)
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from daemon.domain.states import State
from daemon.telemetry.vitals import Vitals

LOOPBACK: Final = "127.0.0.1"
JOB_S = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0, 60.0, 300.0, 1800.0)
SPENT_S = (0.005, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 5.0, 30.0, 300.0)
ERROR_M = (5e-6, 10e-6, 15e-6, 25e-6, 50e-6, 100e-6, 200e-6, 400e-6, 700e-6)
COUNT = (0, 1, 2, 3, 4, 5, 10)
LAG_S = (0.001, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 1.0)
UM_M = 1e-6


class Metrics:
    """Everything counted of one daemon."""

    def __init__(self, station: str, version: str) -> None:
        self.registry = CollectorRegistry()
        self._server: tuple[WSGIServer, threading.Thread] | None = None
        Info("reprobe", "Which program on which station.", registry=self.registry).info(
            {"version": version, "station": station}
        )
        ProcessCollector(registry=self.registry)
        self._make_counts()
        self._make_histograms()
        for state in State:
            self._state.labels(state.value).set(state is State.FAULT)

    def _make_counts(self) -> None:
        known = self.registry
        self._jobs = Counter("reprobe_jobs", "Jobs that ended.", ["op", "outcome"], registry=known)
        self._errors = Counter("reprobe_job_errors", "Jobs that failed.", ["op", "error"], registry=known)
        self._state = Gauge("reprobe_state", "1 for the present state.", ["state"], registry=known)
        self._alerts = Gauge("reprobe_alert_active", "1 while the alert is raised.", ["alert"], registry=known)
        self._touches = Counter(
            "reprobe_touches", "Touches reported by the tester, and made by the daemon itself.", registry=known
        )
        self._retests = Counter("reprobe_retests", "Re-tests reported.", ["result"], registry=known)
        self._events = Counter("reprobe_events", "Events published.", ["topic"], registry=known)

    def _make_histograms(self) -> None:
        def histogram(name: str, text: str, labels: Iterable[str], buckets: tuple[float, ...]) -> Histogram:
            return Histogram(name, text, tuple(labels), buckets=buckets, registry=self.registry)

        self._duration = histogram("reprobe_job_duration_seconds", "Time a job took.", ["op"], JOB_S)
        self._spent = histogram(
            "reprobe_job_spent_seconds", "Where the time went: state, and what was waited for or software.",
            ["op", "state", "wait"], SPENT_S,
        )  # fmt: skip
        self._looks = histogram("reprobe_correction_looks", "Looks a correction took.", [], COUNT)
        self._moves = histogram("reprobe_correction_moves", "Moves a correction took.", [], COUNT)
        self._before = histogram("reprobe_correction_error_before_meters", "Error at the first look.", [], ERROR_M)
        self._after = histogram("reprobe_correction_error_after_meters", "Error at the last look.", [], ERROR_M)
        self._lag = histogram("reprobe_event_loop_lag_seconds", "How late the event loop was.", [], LAG_S)

    # --- counting --------------------------------------------------------------------------------------------

    def take(self, topic: str, body: Mapping[str, Any]) -> None:
        """Count one event as it is published: the same words that were journalled."""
        self._events.labels(topic).inc()
        match topic:
            case "result":
                self._take_result(body)
            case "state":
                for state in State:
                    self._state.labels(state.value).set(state.value == body["state"])
            case "alert":
                self._alerts.labels(str(body.get("name"))).set(bool(body.get("raised")))
            case _:
                pass

    def _take_result(self, result: Mapping[str, Any]) -> None:
        op, error = result["op"], result["error"]
        self._jobs.labels(op, result["outcome"]).inc()
        if error is not None:
            self._errors.labels(op, error["name"]).inc()
        timing: Mapping[str, Mapping[str, float]] = result["timing_ms"]
        self._duration.labels(op).observe(sum(row.get("total", 0.0) for row in timing.values()) / 1e3)
        for state, row in timing.items():
            for wait, ms in row.items():
                if wait != "total":
                    self._spent.labels(op, state, wait).observe(ms / 1e3)
        if op == "correct":
            self._take_correction(result)

    def _take_correction(self, result: Mapping[str, Any]) -> None:
        self._looks.observe(result["looks"])
        self._moves.observe(result["moves"])
        for shown, name in ((self._before, "error_before_um"), (self._after, "error_after_um")):
            if result[name] is not None:
                shown.observe(result[name] * UM_M)

    def report(self, retest: str | None, touches: int) -> None:
        """Count what a tester reported, or a touch of the daemon's own."""
        self._touches.inc(touches)
        if retest is not None:
            self._retests.labels(retest).inc()

    def lag(self, seconds: float) -> None:
        """Count how late the event loop was."""
        self._lag.observe(seconds)

    # --- showing ---------------------------------------------------------------------------------------------

    def watch(self, read: Callable[[], Vitals]) -> None:
        """Read present numbers by `read`, whenever somebody scrapes."""
        self.registry.register(_Present(read))

    def text(self) -> str:
        """Return what a scrape shows."""
        return generate_latest(self.registry).decode()

    def serve(self, port: int) -> None:
        """Serve `/metrics` on loopback; raise OSError if the port is taken."""
        server, thread = start_http_server(port, addr=LOOPBACK, registry=self.registry)
        self._server = server, thread

    @property
    def address(self) -> tuple[str, int] | None:
        """Host and port at which `/metrics` is served; None while it is not."""
        if self._server is None:
            return None
        host, port = self._server[0].server_address[:2]
        return str(host), port

    def close(self) -> None:
        """Stop serving."""
        if self._server is not None:
            server, thread = self._server
            server.shutdown()
            server.server_close()
            thread.join()
            self._server = None


class _Present(Collector):
    """Turns vitals into gauges, and the drivers' own counts into counters."""

    def __init__(self, read: Callable[[], Vitals]) -> None:
        self._read = read

    def describe(self) -> Iterable[Metric]:
        """Say nothing ahead: the registry would otherwise read a daemon that is not open yet."""
        return ()

    def collect(self) -> Iterable[Metric]:
        """Read once."""
        now = self._read()
        yield _gauge("reprobe_fault", "1 for the fault that keeps the station closed.", "fault", dict.fromkeys(
            [now.fault] if now.fault else [], 1.0))  # fmt: skip
        yield _gauge("reprobe_calibration_age_seconds", "Since it was made.", "what", now.calibration_age_s)
        yield GaugeMetricFamily("reprobe_jobs_waiting", "Jobs in the queue.", value=now.waiting)
        yield GaugeMetricFamily("reprobe_threads", "Threads of the daemon.", value=now.threads)
        yield GaugeMetricFamily("reprobe_journal_bytes", "Size of the journal on disk.", value=now.journal_bytes)
        for count, text in _BUS.items():
            rows = {name: float(bus[count]) for name, bus in now.buses.items()}
            yield _counter(f"reprobe_bus_{count}", text, "bus", rows)
        connected = {name: float(bus["connected"]) for name, bus in now.buses.items()}
        yield _gauge("reprobe_bus_connected", "1 while the port is open.", "bus", connected)
        for name, text in _CAMERA.items():
            if name in now.camera:
                yield CounterMetricFamily(f"reprobe_camera_{name}", text, value=now.camera[name])


_BUS: Final = {
    "requests": "Requests on the line.",
    "timeouts": "Requests without an answer.",
    "garbled": "Answers with a wrong CRC or that do not fit.",
    "refused": "Requests a device said no to.",
    "retries": "Requests made again.",
    "reconnects": "Times the lost port was opened again.",
}
_CAMERA: Final = {
    "grabbed": "Frames taken from the camera.",
    "delivered": "Frames handed to who waited.",
    "late": "Frames passed over because they were exposed too early for who waited.",
    "missed": "Frames that never came, by the camera's own numbers.",
    "undecodable": "Frames that arrived torn.",
    "identical": "Frames equal to the one before to the last bit.",
    "timeouts": "Times no frame came.",
    "reopened": "Times the camera was opened again.",
}


def _gauge(name: str, text: str, label: str, rows: Mapping[str, float]) -> Metric:
    family = GaugeMetricFamily(name, text, labels=[label])
    for key, value in rows.items():
        family.add_metric([key], value)
    return family


def _counter(name: str, text: str, label: str, rows: Mapping[str, float]) -> Metric:
    family = CounterMetricFamily(name, text, labels=[label])
    for key, value in rows.items():
        family.add_metric([key], value)
    return family
