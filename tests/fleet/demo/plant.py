"""Plant of the demonstration: ten stations with their uplinks, and the centre's engines, each a process of its own."""

from __future__ import annotations

import json
import signal
import socket
from contextlib import ExitStack
from pathlib import Path

from tests.bench.fleet import NO_TLS, Process, ask
from tests.fleet.demo.planted import Station, stations
from tests.fleet.demo.station import arguments
from tests.fleet.engines import Mosquitto, PostgreSQL, Prometheus

RULES = Path(__file__).parents[3] / "systemd" / "prometheus-rules.yml"
SITE = "demo"


class Plant:
    """Everything that runs; what `stack` holds is ended when that is closed."""

    def __init__(self, folder: Path, stack: ExitStack, *, boards: int, seconds: float, seed: int) -> None:
        self._folder, self.seconds = folder, seconds
        self.database, broker = PostgreSQL(), Mosquitto(folder)
        stack.callback(self.database.remove)
        self.database.start()
        stack.callback(broker.kill)
        broker.start()
        *ports, collect_port = _free_ports(len(stations()) + 1)
        targets = [(f"127.0.0.1:{port}", _labels(one)) for one, port in zip(stations(), ports, strict=True)]
        collect = [(f"127.0.0.1:{collect_port}", dict[str, str]())]
        self.prometheus = Prometheus(folder, RULES, {"reprobe": targets, "reprobe-collect": collect})
        stack.callback(self.prometheus.stop)
        self.prometheus.start()
        told = {"part": "collect", "broker": broker.address, "recent_days": 7, "record_months": None, **NO_TLS}
        self._collect = Process(
            folder / "collect.log", "-m", "daemon.fleet", json.dumps(told | {"metrics_port": collect_port}),
            REPROBE_DATABASE=self.database.url,
        )  # fmt: skip
        stack.callback(self._collect.stop)
        self._stations: dict[str, Process] = {}
        self._uplinks: dict[str, Process] = {}
        self._silenced: set[str] = set()
        for one, port in zip(stations(), ports, strict=True):
            own, endpoint = folder / one.name, f"ipc://{folder}/{one.name}.ipc"
            own.mkdir()
            words = arguments(one, own, endpoint, metrics_port=port, boards=boards, seconds=seconds, seed=seed)
            self._stations[one.name] = Process(folder / f"{one.name}.log", "-m", "tests.fleet.demo.station", words)
            up = {"part": "uplink", "site": SITE, "line": one.line, "station": endpoint, "keys": None, **NO_TLS}
            self._uplinks[one.name] = Process(
                folder / f"uplink-{one.name}.log", "-m", "daemon.fleet", json.dumps(up | {"broker": broker.address})
            )
            stack.callback(self._stations[one.name].stop)
            stack.callback(self._uplinks[one.name].stop)

    def tested(self) -> bool:
        """Whether all stations have tested their boards."""
        return all((self._folder / name / "done").exists() for name in self._stations)

    def written(self) -> dict[str, int]:
        """Return the number of the last record of each station."""
        return {name: int((self._folder / name / "done").read_text()) for name in self._stations}

    def stored(self) -> dict[str, int]:
        """Return how many records of each are stored, where the numbers are without a gap."""
        sql = "SELECT s.name, count(DISTINCT r.seq) FROM records r JOIN stations s ON s.id = r.station GROUP BY s.name"
        return dict(ask(self.database, sql))

    def counted(self) -> dict[str, int]:
        """Return up to which number each station's records are in the rollups that the views read."""
        sql = (
            "SELECT s.name, d.seq FROM rolled d JOIN journals j ON j.id = d.journal JOIN stations s ON s.id = j.station"
        )
        return dict(ask(self.database, sql))

    def silence(self, name: str) -> None:
        """Let a station's computer lose power."""
        self._silenced.add(name)
        self._uplinks[name].stop(signal.SIGKILL)
        self._stations[name].stop(signal.SIGKILL)

    def is_known_alarmed(self, name: str) -> bool:
        """Whether database and Prometheus know of an alert of a station."""
        told = {station for station, alerts in ask(self.database, "SELECT station, alerts FROM stations_now") if alerts}
        return name in told & self._stations_of("reprobe_alert_active == 1")

    def is_known_silent(self, name: str) -> bool:
        """Whether database and Prometheus have noticed."""
        told = {
            station for station, online in ask(self.database, "SELECT station, online FROM stations_now") if not online
        }
        return name in told & self._stations_of('up{job="reprobe"} == 0')

    def _stations_of(self, query: str) -> set[str]:
        return {labels.get("station", "") for labels, _ in self.prometheus.ask(query)}

    def require_alive(self) -> None:
        """Raise RuntimeError with its last words for a process that ended by itself."""
        for name, process in (*self._stations.items(), ("collect", self._collect)):
            if process.is_over and name not in self._silenced:
                raise RuntimeError(f"{name} has ended\n{self.last_words()}")

    def last_words(self) -> str:
        """Return the end of each log that says anything of an error."""
        logs = sorted(self._folder.glob("*.log"))
        return "\n".join(f"{log.name}: {text[-400:]}" for log in logs if "rror" in (text := log.read_text()))


def _labels(station: Station) -> dict[str, str]:
    return {"site": SITE, "line": station.line, "station": station.name}


def _free_ports(count: int) -> list[int]:
    """Return ports that nobody has now, each another one."""
    probes = [socket.socket() for _ in range(count)]
    try:
        for probe in probes:
            probe.bind(("127.0.0.1", 0))
        return [int(probe.getsockname()[1]) for probe in probes]
    finally:
        for probe in probes:
            probe.close()
