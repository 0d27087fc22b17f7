"""Deadline and stopwatch of the station's caller, handed down as one argument."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from daemon.platform.clock import Stopwatch
from drivers.deadline import Deadline


class Clocked(Protocol):
    """By when the caller needs an answer, and the stopwatch on which its waiting is booked; a running job is one."""

    @property
    def deadline(self) -> Deadline:
        """By when it has to be done."""

    @property
    def watch(self) -> Stopwatch:
        """Where waits are booked."""


@dataclass(frozen=True)
class Allowance:
    """A deadline and a stopwatch, for a caller whose deadline is not its job's."""

    deadline: Deadline
    watch: Stopwatch
