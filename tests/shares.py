"""Run of all tests in shares, two at a time: a line whenever a file is done, failures as they come, one summary.

One share computes on one core; the others mostly wait for wires. Files with a failure run once more, alone, where they
are few: it is red all the same, but the last line says whether it is unsteady or fails alone as well.
`python -m tests.shares [ARGUMENTS OF PYTEST]`.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

SEEING = ("tests/vision", "tests/daemon", "tests/sim_hw", "tests/bench")
STATION = "tests/station"
AT_ONCE = 2
FEW_FILES = 3
"""So many with a failure are run once more; more than that is no chance."""


def shares() -> dict[str, list[str]]:
    """Return what each share runs, in the order in which they begin; every file of tests is in one of them."""
    files = sorted(path.as_posix() for path in Path(STATION).glob("test_*.py"))
    rest = ["tests", *(f"--ignore={folder}" for folder in (*SEEING, STATION))]
    # The longest first: those that begin last then end together.
    return {"seeing": list(SEEING), "station": files[1::2], "station too": files[::2], "wired": rest}


COUNTED = re.compile(r"(\d+) (passed|failed|errors?|skipped|xfailed|deselected)")
ENDED = re.compile(r"=*\s*\d+ (?:passed|failed|error|skipped|deselected|xfailed).* in [\d.]+s")
FAILED = re.compile(r"(?:FAILED|ERROR) (\S.*)")


@dataclass
class Share:
    """One run of pytest, and what it said."""

    name: str
    process: subprocess.Popen[str]
    counts: Counter[str] = field(default_factory=Counter)
    failed: list[str] = field(default_factory=list)

    def listen(self) -> None:
        """Print each line as it comes, until the end."""
        assert self.process.stdout is not None
        for line in self.process.stdout:
            text = line.rstrip()
            if text:
                print(f"{self.name}: {text}", flush=True)  # noqa: T201
            if ENDED.match(text):
                self.counts.update({what.rstrip("s"): int(n) for n, what in COUNTED.findall(text)})
            if (found := FAILED.match(text)) and found[1] not in self.failed:
                self.failed.append(found[1])


def main(arguments: list[str]) -> int:
    """Run all; return pytest's worst exit code."""
    began_s = time.monotonic()
    begun: list[Share] = []
    stopped = threading.Event()

    def run(name: str, where: list[str]) -> int | None:
        if stopped.is_set():
            return None
        share = Share(name, _start([*where, *arguments]))
        begun.append(share)
        share.listen()
        return share.process.wait()

    with ThreadPoolExecutor(AT_ONCE) as workers:
        running = [workers.submit(run, name, where) for name, where in shares().items()]
        try:
            ends = [one.result() for one in running]
        except KeyboardInterrupt:
            stopped.set()
            for share in begun:
                share.process.send_signal(signal.SIGINT)
            ends = [one.result() for one in running]
    codes = [share.process.returncode for share in begun]
    files = [] if None in ends else unsteady_perhaps(begun, codes)
    again = run("once more", [*files, *arguments]) if files else None
    print(summary(begun[: len(codes)], codes, time.monotonic() - began_s, again), flush=True)  # noqa: T201
    return max((*codes, *(130 for end in ends if end is None)), key=abs)


def unsteady_perhaps(begun: list[Share], codes: list[int]) -> list[str]:
    """Return the files with a failure where it may be chance: they are few, and each share came to its end."""
    files = sorted({name.split("::")[0] for share in begun for name in share.failed})
    return files if len(files) <= FEW_FILES and set(codes) <= {0, 1, 5} else []


def _start(arguments: list[str]) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "pytest", "-p", "tests.failures_at_once", "--tb=short", "-rfE", *arguments]
    environment = {**os.environ, "PYTHONUNBUFFERED": "1", "COLUMNS": "110"}
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment)


def summary(begun: list[Share], codes: list[int], took_s: float, again: int | None = None) -> str:
    """Say in one plain sentence how it ended, and what failed; `again`: how the files with a failure ended alone."""
    counts: Counter[str] = sum((share.counts for share in begun), Counter())
    bad = counts["failed"] + counts["error"]
    failed = [name for share in begun for name in share.failed]
    cut = [share.name for share, code in zip(begun, codes, strict=True) if code not in {0, 1, 5}]
    passed, skipped = counts["passed"], counts["skipped"]
    lines = [f"{passed} tests passed, {bad} failed, {skipped} skipped, in {took_s / 60:.1f} minutes"]
    lines += [f"  failed: {name}" for name in failed]
    lines += [f"  the share {name!r} did not come to its end" for name in cut]
    well = passed > 0 and all(code in {0, 5} for code in codes)
    lines.append("all is well" if well else "not all is well" if passed or bad else "no test was run")
    if again is not None:
        lines[-1] = f"not all is well: what failed {'failed again' if again else 'passed'} alone"
    return "\n".join(["", *lines])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
