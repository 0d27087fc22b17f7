"""A Debian machine in namespaces: a real systemd as PID 1, and this program installed in it."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from tests.packages import not_installed
from tests.system.systemd import Systemd

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
CACHE = Path(os.environ.get("REPROBE_TEST_CACHE", "/var/cache/reprobe-tests"))
REQUIREMENTS = ROOT / "requirements" / "sim.txt"
TREE = (str(HERE / "make_tree.sh"), str(CACHE), sys.executable, str(REQUIREMENTS))
UP_WITHIN_S = 60.0
NSENTER = shutil.which("nsenter") or "nsenter"
NAMESPACES = ("-m", "-p", "-n", "-i", "-u", "-C")


class Machine(Systemd):
    """A booted machine; made by `booted`."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        """systemd's process number, seen from outside."""

    def path(self, inside: str) -> Path:
        """Return a file of the machine, seen from outside."""
        return Path(f"/proc/{self.pid}/root{inside}")

    def call(self, *command: str, within_s: float) -> tuple[int, str]:
        """Run a command as the machine's root and return its exit code and what it printed."""
        done = subprocess.run(
            [NSENTER, "-t", str(self.pid), *NAMESPACES, "--", *command],
            check=False, capture_output=True, text=True, timeout=within_s, stdin=subprocess.DEVNULL,
            env={"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "LC_ALL": "C.UTF-8"},
        )  # fmt: skip
        return done.returncode, done.stdout + done.stderr


def why_not() -> str | None:
    """Return what keeps this computer from booting such a machine at once; None when nothing does."""
    if os.geteuid() != 0:
        return "needs root: namespaces with a systemd as PID 1"
    if not any(line.split()[2] == "cgroup2" for line in Path("/proc/mounts").read_text().splitlines()):
        return "needs a mounted cgroup2"
    if shutil.which(NSENTER) is None or shutil.which("unshare") is None:
        return not_installed("util-linux")
    if subprocess.run([TREE[0], "-n", *TREE[1:]], check=False, stdout=subprocess.DEVNULL).returncode == 0:
        return None
    if os.environ.get("REPROBE_TEST_SYSTEMD") != "build":
        return "the machine's tree has not been built; `make test-systemd` does it"
    return not_installed("mmdebstrap") if shutil.which("mmdebstrap") is None else None


def build_wheel(work: Path) -> Path:
    """Build the package as it is copied to a station; return its file in `work`."""
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(work)]
    done = subprocess.run(build, check=False, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    assert done.returncode == 0, done.stdout
    (wheel,) = work.glob("*.whl")
    return wheel


@contextmanager
def booted(work: Path) -> Iterator[Machine]:
    """Build what is not there yet, boot, and take everything down afterwards."""
    tree = _last_line(TREE)
    wheel = build_wheel(work)
    place = work / "machine"
    place.mkdir()
    with (work / "boot.log").open("wb") as words:
        process = subprocess.Popen(
            [str(HERE / "boot.sh"), tree, str(place), str(wheel)],
            stdin=subprocess.DEVNULL, stdout=words, stderr=words, start_new_session=True,
        )  # fmt: skip
    try:
        yield _up(process, work / "boot.log")
    finally:
        process.send_signal(signal.SIGKILL)  # unshare ignores anything milder
        process.wait()
        _forget_group(place / "cgroup")


def _up(process: subprocess.Popen[bytes], words: Path) -> Machine:
    """Wait until systemd answers."""
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    give_up_s = time.monotonic() + UP_WITHIN_S
    while time.monotonic() < give_up_s:
        assert process.poll() is None, words.read_text(errors="replace")[-3000:]
        inner = children.read_text().split()
        if inner and Path(f"/proc/{inner[0]}/comm").read_text().strip() == "systemd":
            machine = Machine(int(inner[0]))
            if machine.run("systemctl", "is-system-running", fails=True).strip() in ("running", "degraded"):
                return machine
        time.sleep(0.1)
    raise AssertionError(f"not up: {words.read_text(errors='replace')[-3000:]}")


def _forget_group(file: Path) -> None:
    """Remove the machine's control groups, innermost first."""
    if not file.is_file():
        return
    top = Path(file.read_text().strip())
    groups = [*sorted((g for g in top.rglob("*") if g.is_dir()), key=lambda g: -len(g.parts)), top]
    give_up_s = time.monotonic() + Systemd.eventually_s
    while groups and time.monotonic() < give_up_s:
        for group in tuple(groups):
            with contextlib.suppress(OSError):  # its last process is still on its way out
                group.rmdir()
                groups.remove(group)
        time.sleep(0.05)


def _last_line(command: Sequence[str]) -> str:
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    return done.stdout.splitlines()[-1]
