"""How long the daemon takes from its first instruction to READY, on a simulated station in real time.

Run by name: `python -m tests.bench.start`. The bound is 2 s on two idle cores. The station is homed, as it is when a
daemon is started again: that is the most that is asked of its drives. On a machine that has other work, the daemon's
own time of a core says more than the clock. With PYTHONDONTWRITEBYTECODE set each start compiles all modules again:
0.3 s that no installed daemon takes.
"""

from __future__ import annotations

import os
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tests.bench.idle import cpu_s
from tests.station.rig import Rig, running_rig

STARTS = 7
GIVE_UP_S = 60.0


def main() -> None:
    """Start it a few times and print what it took."""
    with tempfile.TemporaryDirectory() as out, running_rig(Path(out), arguments=()) as rig:
        with rig.client(60.0) as client:
            client.job("home")
        rig.daemon.end()
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
            manager.bind(str(rig.places.sockets / "notify"))
            manager.settimeout(GIVE_UP_S)
            starts = [_start(rig, manager) for _ in range(STARTS)]
    for what, taken_s in zip(("start to READY", "of a core"), zip(*starts, strict=True), strict=True):
        print(f"{what}: median {statistics.median(taken_s):.2f} s, best {min(taken_s):.2f}, worst {max(taken_s):.2f}")


def _start(rig: Rig, manager: socket.socket) -> tuple[float, float]:
    """Start, wait for READY, stop; return how long the first took, and how much of a core, s."""
    command = [sys.executable, "-m", "daemon.cli", "serve", "--json", "--config", str(rig.places.out / "station.toml")]
    environment = {**os.environ, "NOTIFY_SOCKET": str(rig.places.sockets / "notify")}
    with (rig.places.out / "start.log").open("wb") as words:
        began_s = time.monotonic()
        daemon = subprocess.Popen(command, env=environment, stderr=words)
        try:
            while b"READY=1" not in manager.recv(4096):
                pass
            return time.monotonic() - began_s, cpu_s(daemon.pid)
        finally:
            daemon.terminate()
            manager.setblocking(False)
            daemon.wait()
            _drain(manager)
            manager.settimeout(GIVE_UP_S)


def _drain(manager: socket.socket) -> None:
    """Throw away what was said on the way out."""
    try:
        while True:
            manager.recv(4096)
    except BlockingIOError:
        return


if __name__ == "__main__":
    main()
