"""Processes of a demonstration, started and ended."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import zmq

from daemon.client import Client, NoAnswer

READY_WITHIN_S = 60.0
END_WITHIN_S = 10.0


class StartError(Exception):
    """A process did not come up; the message carries what it said."""


class Process:
    """A child process whose words go to a log file; ended by its pid."""

    def __init__(self, name: str, arguments: list[str], log: Path, *, ready_line: bool) -> None:
        self.name = name
        self._log = log
        with log.open("wb") as words:
            # One numeric thread a process: the three share the machine, and pools that spin would starve each other.
            self._popen = subprocess.Popen(
                [sys.executable, "-m", *arguments],
                stdout=subprocess.PIPE if ready_line else words,
                stderr=words,
                stdin=subprocess.DEVNULL,
                env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
            )

    @property
    def pid(self) -> int:
        """Its process number."""
        return self._popen.pid

    def ready(self) -> dict[str, Any]:
        """Wait for the one JSON line that says the process serves."""
        line = self._popen.stdout.readline() if self._popen.stdout else b""
        if not line:
            raise StartError(f"{self.name} ended at once: {self.last_words()}")
        answer: dict[str, Any] = json.loads(line)
        return answer

    def alive(self) -> bool:
        """Whether it still runs."""
        return self._popen.poll() is None

    def last_words(self) -> str:
        """Return the end of its log."""
        text = self._log.read_text(errors="replace").strip()
        return text[-2000:] or f"(it said nothing, exit code {self._popen.poll()})"

    def wait(self) -> int:
        """Wait until it ends by itself; return its exit code."""
        return self._popen.wait(READY_WITHIN_S)

    def kill(self) -> None:
        """End it as a power cut would."""
        self._popen.kill()
        self._popen.wait()

    def end(self) -> int:
        """Ask it to end, then insist; return its exit code."""
        self._popen.terminate()
        try:
            return self._popen.wait(END_WITHIN_S)
        except subprocess.TimeoutExpired:
            self._popen.kill()
            return self._popen.wait()
        finally:
            if self._popen.stdout:
                self._popen.stdout.close()


def wait_for_daemon(process: Process, control: str) -> None:
    """Wait until the daemon has opened its devices: it says `not_homed`, or nothing is wrong at all."""
    with Client(control, timeout_s=1.0) as client:
        give_up_s = time.monotonic() + READY_WITHIN_S
        while time.monotonic() < give_up_s:
            if not process.alive():
                raise StartError(f"the daemon ended: {process.last_words()}")
            try:
                status = client.request("status")
            except NoAnswer:
                continue
            fault = status["fault"]
            if fault and fault["name"] != "not_homed":
                raise StartError(f"the daemon is not ready: {fault['message']}; {fault['advice']}")
            if fault or status["state"] == "idle":
                return
            time.sleep(0.05)
    raise StartError(f"the daemon was not ready within {READY_WITHIN_S:g} s: {process.last_words()}")


class DemoBench:
    """The simulated station's bench socket: what a person with a microscope would know. The daemon never sees it."""

    def __init__(self, endpoint: str) -> None:
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.REQ)
        self._socket.connect(endpoint)

    def ask(self, cmd: str, **fields: Any) -> dict[str, Any]:
        """Send one command and return the reply."""
        self._socket.send_json({"cmd": cmd, **fields})
        if not self._socket.poll(10_000):
            raise StartError("the simulated station does not answer on its bench socket")
        reply: dict[str, Any] = json.loads(self._socket.recv())
        if not reply.get("ok"):
            raise StartError(f"the simulated station refused {cmd!r}: {reply.get('error')}")
        return reply

    def close(self) -> None:
        """Let go of it."""
        self._socket.close(linger=0)
        self._context.term()
