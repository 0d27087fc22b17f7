"""The fleet's engines of Debian, each a process of its own on loopback: Mosquitto, PostgreSQL and Prometheus."""

from __future__ import annotations

import json
import os
import pwd
import shutil
import signal
import socket
import subprocess
import tempfile
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

POSTGRES = sorted(Path("/usr/lib/postgresql").glob("*/bin"))
UNPRIVILEGED = ("postgres", "nobody")
READY_S = 30.0


def missing(wanted: Sequence[str] = ("mosquitto", "postgresql")) -> list[str]:
    """Return which of Debian's packages are not installed."""
    found = {
        "mosquitto": shutil.which("mosquitto", path=f"{os.environ['PATH']}:/usr/sbin"),
        "postgresql": POSTGRES,
        "prometheus": shutil.which("prometheus"),
    }
    return [name for name in wanted if not found[name]]


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def wait_for_port(port: int, process: subprocess.Popen[bytes], log: Path) -> None:
    give_up_s = time.monotonic() + READY_S
    while True:
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return
        if process.poll() is not None or time.monotonic() > give_up_s:
            raise RuntimeError(f"no engine on port {port}: {log.read_text()[-2000:]}")
        time.sleep(0.02)


class Mosquitto:
    """One broker; what it keeps in memory is gone when it is killed."""

    def __init__(self, folder: Path) -> None:
        self.port = free_port()
        self._file, self._log = folder / "mosquitto.conf", folder / "mosquitto.log"
        self._file.write_text(f"listener {self.port} 127.0.0.1\nallow_anonymous true\nmax_queued_messages 100000\n")
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def address(self) -> str:
        return f"127.0.0.1:{self.port}"

    def start(self) -> None:
        program = shutil.which("mosquitto", path=f"{os.environ['PATH']}:/usr/sbin")
        assert program is not None
        with self._log.open("ab") as log:
            self._process = subprocess.Popen([program, "-c", str(self._file)], stdout=log, stderr=log)
        wait_for_port(self.port, self._process, self._log)

    def kill(self) -> None:
        end(self._process, signal.SIGKILL)


class PostgreSQL:
    """One cluster of its own, run by a user that may do nothing else; PostgreSQL refuses to run as root."""

    def __init__(self, **settings: str) -> None:
        """`settings`: of the server, beside those that every test has."""
        self.port, self._settings = free_port(), settings
        # No folder of pytest's: those are closed to every other user, again and again.
        self._folder = tempfile.TemporaryDirectory(prefix="reprobe-postgres-")
        folder = Path(self._folder.name)
        self._bin, self._data, self._log = POSTGRES[-1], folder / "data", folder / "postgres.log"
        self._user = next((n for n in UNPRIVILEGED if _is_user(n)), None) if os.geteuid() == 0 else None
        self._log.touch()
        if self._user is not None:
            shutil.chown(folder, self._user)
        made = [
            str(self._bin / "initdb"),
            "-D",
            str(self._data),
            "-U",
            "reprobe",
            "-A",
            "trust",
            "-E",
            "UTF8",
            "--no-locale",
            "-N",
        ]
        subprocess.run(made, check=True, capture_output=True, user=self._user, cwd=folder)
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def url(self) -> str:
        return f"postgresql://reprobe@127.0.0.1:{self.port}/postgres"

    def start(self) -> None:
        program = [str(self._bin / "postgres"), "-D", str(self._data), "-p", str(self.port), "-k", ""]
        settings = ["-c", "listen_addresses=127.0.0.1", "-c", "shared_buffers=32MB", "-c", "max_connections=20"]
        settings += [word for name, value in self._settings.items() for word in ("-c", f"{name}={value}")]
        with self._log.open("ab") as log:
            self._process = subprocess.Popen(
                [*program, *settings], stdout=log, stderr=log, user=self._user, cwd=self._data
            )
        wait_for_port(self.port, self._process, self._log)
        ready = [str(self._bin / "pg_isready"), "-q", "-h", "127.0.0.1", "-p", str(self.port)]
        while subprocess.run(ready, check=False).returncode:
            assert self._process.poll() is None, self._log.read_text()[-2000:]
            time.sleep(0.05)

    def restart_at_once(self) -> None:
        """Restart without a word to anybody, as after a crash (PostgreSQL: immediate shutdown)."""
        self.stop()
        self.start()

    def stop(self) -> None:
        end(self._process, signal.SIGQUIT)

    def remove(self) -> None:
        self.stop()
        self._folder.cleanup()


class Prometheus:
    """One Prometheus with rules; `targets`: job -> the targets it scrapes, each an address with its labels."""

    def __init__(
        self, folder: Path, rules: Path, targets: Mapping[str, Sequence[tuple[str, Mapping[str, str]]]]
    ) -> None:
        self.port = free_port()
        self._folder, self._log = folder, folder / "prometheus.log"
        scrapes = [
            {"job_name": job, "static_configs": [{"targets": [at], "labels": dict(labels)} for at, labels in found]}
            for job, found in targets.items()
        ]
        every = {"scrape_interval": "1s", "scrape_timeout": "1s", "evaluation_interval": "1s"}
        told = {"global": every, "rule_files": [str(rules)], "scrape_configs": scrapes}
        (folder / "prometheus.yml").write_text(json.dumps(told))  # JSON is YAML
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def start(self) -> None:
        program = shutil.which("prometheus")
        assert program is not None
        files = [f"--config.file={self._folder}/prometheus.yml", f"--storage.tsdb.path={self._folder}/tsdb"]
        with self._log.open("ab") as log:
            self._process = subprocess.Popen(
                [program, *files, f"--web.listen-address=127.0.0.1:{self.port}"], stdout=log, stderr=log
            )
        wait_for_port(self.port, self._process, self._log)

    def ask(self, query: str) -> list[tuple[dict[str, str], float]]:
        """Return the samples an expression gives now; ValueError with Prometheus' words for one it cannot read."""
        return [(one["metric"], float(one["value"][1])) for one in self._get("query", query=query)]

    def ask_over(
        self, query: str, seconds: float, steps: int
    ) -> list[tuple[dict[str, str], list[tuple[float, float]]]]:
        """Return an expression's series over the last so many seconds: times (Unix) and values."""
        end_s = time.time()
        series = self._get("query_range", query=query, start=end_s - seconds, end=end_s, step=seconds / steps)
        return [(one["metric"], [(float(at), float(value)) for at, value in one["values"]]) for one in series]

    def _get(self, what: str, **asked: str | float) -> list[dict[str, Any]]:
        at = f"{self.url}/api/v1/{what}?{urllib.parse.urlencode(asked)}"
        try:
            with urllib.request.urlopen(at, timeout=10.0) as answer:  # noqa: S310  # loopback
                said: dict[str, Any] = json.load(answer)
        except urllib.error.HTTPError as exc:
            if exc.code == 503:  # it is still starting
                return []
            raise ValueError(f"{asked['query']}: {exc.read().decode(errors='replace')}") from exc
        found: list[dict[str, Any]] = said["data"]["result"]
        return found

    def stop(self) -> None:
        end(self._process)


def _is_user(name: str) -> bool:
    try:
        pwd.getpwnam(name)
    except KeyError:
        return False
    return True


def end(process: subprocess.Popen[bytes] | None, how: signal.Signals = signal.SIGTERM) -> None:
    """End a process of ours, and wait for it."""
    if process is not None and process.poll() is None:
        process.send_signal(how)
        try:
            process.wait(10.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


@contextmanager
def engines(folder: Path, **settings: str) -> Iterator[tuple[Mosquitto, PostgreSQL]]:
    """Run both, ready; `settings`: of PostgreSQL."""
    broker, database = Mosquitto(folder), PostgreSQL(**settings)
    try:
        broker.start()
        database.start()
        yield broker, database
    finally:
        broker.kill()
        database.remove()
