"""An emulated PC under Debian: its own kernel, udev and systemd, real device nodes. Never KVM."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from tests.packages import not_installed
from tests.system.machine import CACHE, REQUIREMENTS
from tests.system.systemd import Systemd
from tests.vm.agent import Agent

HERE = Path(__file__).parent
IMAGE = (str(HERE / "make_image.sh"), str(CACHE), sys.executable, str(REQUIREMENTS))
QEMU = "qemu-system-x86_64"
UP_WITHIN_S = 240.0
GREETED_WITHIN_S = 2.0
OWN_ADDRESS, HOST_ADDRESS, NETWORK = "10.0.2.15", "10.0.2.2", "10.0.2.0/24"
"""QEMU's user-mode network: the host's loopback is HOST_ADDRESS in there."""
CARD = "eth0"


@dataclass(frozen=True)
class Wires:
    """What of the host the machine is wired to."""

    line: Path
    """A terminal: the machine's second serial port, ttyS1."""
    ports: dict[int, int]
    """TCP ports of the host's loopback that lead to a port of the machine."""


class Vm(Systemd):
    """A booted machine; made by `booted`."""

    eventually_s = 240.0

    def __init__(self, agent: Agent) -> None:
        self._agent = agent

    def call(self, *command: str, within_s: float) -> tuple[int, str]:
        """Run a command as the machine's root and return its exit code and what it printed."""
        return self._agent.call(*command, within_s=within_s)

    def put(self, path: str, content: bytes | str, mode: str = "644") -> None:
        """Write a file of the machine."""
        given = content.encode() if isinstance(content, str) else content
        write = 'mkdir -p "$(dirname "$0")" && cat >"$0" && chmod "$1" "$0"'
        code, said = self._agent.call("/bin/sh", "-c", write, path, mode, within_s=60.0, given=given)
        assert code == 0, f"{path}: {said}"

    def get(self, path: str) -> str:
        """Read a file of the machine."""
        return self.run("cat", path)

    def join_network(self) -> None:
        """Give the machine its address; it has no route to anywhere but the host."""
        self.run("udevadm", "settle")
        self.run("ip", "address", "add", f"{OWN_ADDRESS}/24", "dev", CARD)
        self.run("ip", "link", "set", CARD, "up")


def why_not() -> str | None:
    """Return what keeps this computer from emulating such a machine; None when nothing does."""
    if shutil.which(QEMU) is None:
        return not_installed("qemu-system-x86")
    if subprocess.run([IMAGE[0], "-n", *IMAGE[1:]], check=False, stdout=subprocess.DEVNULL).returncode == 0:
        return None
    if os.geteuid() != 0:
        return "needs root to build the machine's disk, once"
    return not_installed("mmdebstrap") if shutil.which("mmdebstrap") is None else None


@contextmanager
def booted(work: Path, wires: Wires) -> Iterator[Vm]:
    """Build the disk if it is not there yet, boot a machine that forgets, and take it down afterwards."""
    built = subprocess.run(IMAGE, check=True, stdout=subprocess.PIPE, text=True)
    image = Path(built.stdout.splitlines()[-1])
    with (work / "qemu.log").open("wb") as words:
        process = subprocess.Popen(_command(image, work, wires), stdin=subprocess.DEVNULL, stdout=words, stderr=words)
    agent = None
    try:
        agent = _up(process, work)
        vm = Vm(agent)
        vm.run("systemctl", "is-system-running", "--wait", fails=True, within_s=UP_WITHIN_S)
        yield vm
    finally:
        if agent is not None:
            agent.close()
        process.kill()  # its disk is thrown away: nothing is lost
        process.wait()


def _command(image: Path, work: Path, wires: Wires) -> list[str]:
    forwards = "".join(f",hostfwd=tcp:127.0.0.1:{here}-{OWN_ADDRESS}:{there}" for here, there in wires.ports.items())
    return [
        # Always the slow way: a /dev/kvm that can be opened may still hang.
        QEMU, "-accel", "tcg,thread=multi", "-cpu", "max", "-smp", "2", "-m", "2048",
        "-nodefaults", "-no-user-config", "-display", "none", "-no-reboot",
        "-kernel", str(image / "vmlinuz"), "-initrd", str(image / "initrd"),
        "-append", "root=/dev/vda rw console=ttyS0 quiet panic=-1 mitigations=off net.ifnames=0",
        "-drive", f"file={image / 'disk.img'},format=raw,if=virtio,snapshot=on",
        "-netdev", f"user,id=net{forwards}", "-device", "virtio-net-pci,netdev=net",
        "-device", "virtio-rng-pci", "-device", "virtio-serial-pci",
        "-chardev", f"socket,id=agent,path={work / 'agent'},server=on,wait=off",
        "-device", "virtserialport,chardev=agent,name=org.qemu.guest_agent.0",
        # ttyS0 is the console, ttyS1 the station's line, ttyS2 leads nowhere.
        "-serial", f"file:{work / 'console.log'}",
        "-chardev", f"serial,id=line,path={wires.line}", "-serial", "chardev:line", "-serial", "null",
    ]  # fmt: skip


def _up(process: subprocess.Popen[bytes], work: Path) -> Agent:
    """Wait until the agent answers."""
    give_up_s, number, agent = time.monotonic() + UP_WITHIN_S, 0, None
    while time.monotonic() < give_up_s:
        assert process.poll() is None, (work / "qemu.log").read_text(errors="replace")[-3000:]
        if agent is None and (work / "agent").exists():
            agent = Agent(work / "agent")
        number += 1
        if agent is None:
            time.sleep(0.05)
        elif agent.greet(number, GREETED_WITHIN_S):
            return agent
    raise AssertionError(f"not up: {(work / 'console.log').read_text(errors='replace')[-3000:]}")
