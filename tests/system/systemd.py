"""What is asked of a real systemd with this program in it, however the machine around it is made."""

from __future__ import annotations

import abc
import time
from collections.abc import Callable


class Systemd(abc.ABC):
    """A booted machine whose commands are run as root; each kind of machine says how."""

    eventually_s = 30.0
    """What has to happen happens within this."""

    @abc.abstractmethod
    def call(self, *command: str, within_s: float) -> tuple[int, str]:
        """Run a command as the machine's root and return its exit code and what it printed."""

    def run(self, *command: str, fails: bool = False, within_s: float = 90.0) -> str:
        """Run a command and return what it printed; `fails`: it may."""
        code, said = self.call(*command, within_s=within_s)
        assert fails or code == 0, f"{command}: {said}"
        return said

    def show(self, name: str, unit: str = "reprobe.service") -> str:
        """Return one property of a unit."""
        return self.run("systemctl", "show", "--value", "-p", name, unit).strip()

    def until(self, holds: Callable[[], bool], complaint: str) -> None:
        """Wait until something is so."""
        give_up_s = time.monotonic() + self.eventually_s
        while not holds():
            assert time.monotonic() < give_up_s, f"{complaint}\n{self.log()}"
            time.sleep(0.05)

    def until_status(self, text: str) -> None:
        """Wait until the unit's status line contains a text."""
        self.until(lambda: text in self.show("StatusText"), f"the status never said {text!r}")

    def log(self, unit: str = "reprobe.service") -> str:
        """Return the end of a unit's log."""
        return self.run("journalctl", "-b", "-n", "60", "--no-pager", "-o", "cat", "-u", unit, fails=True)

    def main_pid(self) -> int:
        """Return the daemon's process number inside of the machine."""
        return int(self.show("MainPID"))

    def in_group_of(self, unit: str, *command: str) -> bool:
        """Run a command as root in a unit's control group, under its device and address lists alone; tell if it worked.

        Namespaces and rights of the unit do not apply: what is refused is refused by those lists.
        """
        joined = 'echo $$ > "/sys/fs/cgroup$0/cgroup.procs" && exec "$@"'
        group = self.show("ControlGroup", unit)
        assert group
        return self.call("/bin/sh", "-c", joined, group, *command, within_s=90.0)[0] == 0
