"""QEMU's guest agent, seen from the host: commands in the emulated machine, as its root, over a virtual serial port."""

from __future__ import annotations

import base64
import json
import socket
import time
from pathlib import Path
from typing import Any

ENVIRONMENT = ["PATH=/usr/sbin:/usr/bin:/sbin:/bin", "LC_ALL=C.UTF-8"]
SOON_S, SELDOM_S = 0.02, 0.25
"""How often it is asked whether a command has ended: first and later. Each question costs the machine some time."""
PATIENCE_S = 60.0
"""The agent itself answers within this, however busy the machine is."""


class AgentSilent(AssertionError):
    """The agent did not answer in time."""


class Agent:
    """One connection to the agent; `greet` it before anything else."""

    def __init__(self, path: Path) -> None:
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.connect(str(path))
        self._rest = b""

    def close(self) -> None:
        """Let go of it."""
        self._socket.close()

    def greet(self, number: int, within_s: float) -> bool:
        """Say something and tell whether the agent said it back: what it had left to say before is passed over."""
        self._send("guest-sync", {"id": number})
        give_up_s = time.monotonic() + within_s
        try:
            while self._receive(give_up_s).get("return") != number:
                pass
        except AgentSilent:
            return False
        return True

    def call(self, *command: str, within_s: float, given: bytes = b"") -> tuple[int, str]:
        """Run a command and return its exit code and what it printed, its errors last; `given` is its input."""
        arguments: dict[str, Any] = {
            "path": command[0], "arg": list(command[1:]), "env": ENVIRONMENT, "capture-output": True,
        }  # fmt: skip
        if given:
            arguments["input-data"] = base64.b64encode(given).decode()
        pid = self._ask("guest-exec", arguments)["pid"]
        give_up_s, pause_s = time.monotonic() + within_s, SOON_S
        while not (status := self._ask("guest-exec-status", {"pid": pid}))["exited"]:
            if time.monotonic() > give_up_s:
                self._ask("guest-exec", {"path": "kill", "arg": ["-KILL", str(pid)]})
                raise AssertionError(f"{' '.join(command)[:300]}: not done within {within_s:g} s")
            time.sleep(pause_s)
            pause_s = min(1.3 * pause_s, SELDOM_S)
        said = b"".join(base64.b64decode(status.get(name, "")) for name in ("out-data", "err-data"))
        code = status.get("exitcode", 128 + status.get("signal", 0))
        return int(code), said.decode(errors="replace")

    def _ask(self, name: str, arguments: dict[str, Any]) -> dict[str, Any]:
        self._send(name, arguments)
        reply = self._receive(time.monotonic() + PATIENCE_S)
        assert "return" in reply, f"{name} {arguments.get('path', '')}: {reply.get('error', reply)}"
        answer: dict[str, Any] = reply["return"]
        return answer

    def _send(self, name: str, arguments: dict[str, Any]) -> None:
        self._socket.settimeout(PATIENCE_S)
        self._socket.sendall(json.dumps({"execute": name, "arguments": arguments}).encode() + b"\n")

    def _receive(self, give_up_s: float) -> dict[str, Any]:
        """Return the next reply, which is one line."""
        while b"\n" not in self._rest:
            self._socket.settimeout(max(0.001, give_up_s - time.monotonic()))
            try:
                came = self._socket.recv(65536)
            except TimeoutError:
                raise AgentSilent("the machine's agent does not answer") from None
            assert came, "the machine is gone"
            self._rest += came
        line, _, self._rest = self._rest.partition(b"\n")
        reply: dict[str, Any] = json.loads(line.lstrip(b"\xff"))
        return reply
