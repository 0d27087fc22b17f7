"""How much the daemon costs while nobody asks for anything: CPU share of one core and resident memory.

    python -m tests.bench.idle [SECONDS]

Starts a simulated station and a daemon, homes and calibrates, lets them rest, and reads the daemon's own accounting
from /proc; then again with a daemon that was started anew and corrected once, as on every working day: what only
calibrations need is not loaded there. Prints two lines; judges nothing.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path

from tests.station.rig import Rig, running_rig

TICKS_S = os.sysconf("SC_CLK_TCK")
SETTLE_S = 35.0
"""Until all of a job's leavings are done and its memory is given back."""
PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")


def cpu_s(pid: int) -> float:
    """Return user plus system time of a process, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / TICKS_S


def resident_mb(pid: int) -> float:
    """Return the resident set of a process, MB."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * PAGE_BYTES / 1e6


def rest(rig: Rig, seconds: float, when: str) -> None:
    """Let the daemon rest, and print what that costs."""
    time.sleep(SETTLE_S)
    begin_s, begin_cpu_s = time.monotonic(), cpu_s(rig.daemon.pid)
    time.sleep(seconds)
    share = (cpu_s(rig.daemon.pid) - begin_cpu_s) / (time.monotonic() - begin_s)
    print(
        f"{when}: idle {seconds:.0f} s, {100 * share:.2f} % of one core, {resident_mb(rig.daemon.pid):.0f} MB resident"
    )


def main() -> None:
    """Measure twice."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 30.0
    with tempfile.TemporaryDirectory() as folder, running_rig(Path(folder), arguments=()) as rig:
        with rig.client() as client:
            rig.session(client).set_up()
        rest(rig, seconds, "after calibrating")
        rig.daemon.end()
        rig.start_daemon()
        with rig.client() as client:
            client.job("place", test_point="TP1", theta_deg=0.0)
            client.job("correct", test_point="TP1")
        rest(rig, seconds, "started anew, after a correction")


if __name__ == "__main__":
    main()
