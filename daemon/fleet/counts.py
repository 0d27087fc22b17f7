"""Counts of the collector, for Prometheus: what was stored, lost and refused, station by station."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from prometheus_client import CollectorRegistry, Counter, Gauge, start_http_server

from daemon.fleet.database import Arrived, Taken
from daemon.fleet.topics import BadName, StationPath

LABELS = ("site", "line", "station")


class Counts:
    """What one collector did since it was started."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        self._rows = Counter("reprobe_collect_rows", "Records stored.", registry=self.registry)
        self._batches = Counter("reprobe_collect_batches", "Batches received.", LABELS, registry=self.registry)
        self._lost = Counter(
            "reprobe_collect_lost", "Numbers a station could no longer send.", LABELS, registry=self.registry
        )
        self._refused = Counter(
            "reprobe_collect_refused", "Messages and rows that cannot be stored.", LABELS, registry=self.registry
        )
        self._bad_pads = Gauge(
            "reprobe_collect_bad_pads", "Pads that miss at three stations or more.", ["board"], registry=self.registry
        )
        self._last = Gauge(
            "reprobe_collect_last_batch_seconds", "When a batch came last, Unix time.", LABELS, registry=self.registry
        )

    def serve(self, port: int) -> None:
        """Answer Prometheus on loopback; raise OSError if the port is taken."""
        start_http_server(port, addr="127.0.0.1", registry=self.registry)

    def stored(self, arrived: Sequence[Arrived], taken: Taken) -> None:
        """Count a group that was stored."""
        self._rows.inc(taken.rows)
        for path, _ in arrived:
            self._batches.labels(*_labels(path)).inc()
            self._last.labels(*_labels(path)).set_to_current_time()
        for path, count in taken.lost:
            self._lost.labels(*_labels(path)).inc(count)

    def bad_pads(self, pads: Mapping[str, int]) -> None:
        """Show how many pads of each board design miss at many stations."""
        for board, count in pads.items():
            self._bad_pads.labels(board).set(count)

    def refused(self, topic: str) -> None:
        """Count what cannot be stored."""
        try:
            self._refused.labels(*_labels(StationPath.of(topic))).inc()
        except BadName:
            self._refused.labels("", "", "").inc()


def _labels(path: StationPath) -> tuple[str, str, str]:
    return path.site, path.line, path.station
