"""The steps in which a writer changes the disk: count them, and do something before one of them."""

from __future__ import annotations

import errno
import io
import os
import signal
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any
from unittest.mock import patch

CALLS = ("mkdir", "open", "fsync", "link", "rename", "replace", "unlink", "remove")
"""Of `os`; a file opened for writing counts, too. What is only read is no step."""


class Steps:
    """Count the steps; before number `at`, from 1 on, do `act`. `taken` says what came, in order."""

    def __init__(self, at: int, act: Callable[[], None]) -> None:
        self.taken: list[str] = []
        self._at, self._act = at, act

    @property
    def reached(self) -> bool:
        """Whether there were so many steps."""
        return len(self.taken) >= self._at

    @contextmanager
    def watched(self) -> Iterator[None]:
        """Count what is done inside."""
        with ExitStack() as stack:
            for name in CALLS:
                stack.enter_context(patch.object(os, name, self._counted(name, getattr(os, name))))
            stack.enter_context(patch.object(io, "open", self._opened(io.open)))
            yield

    def _step(self, name: str) -> None:
        self.taken.append(name)
        if len(self.taken) == self._at:
            self._act()

    def _counted(self, name: str, real: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **named: Any) -> Any:
            self._step(name)
            return real(*arguments, **named)

        return call

    def _opened(self, real: Callable[..., Any]) -> Callable[..., Any]:
        def call(file: Any, mode: str = "r", *arguments: Any, **named: Any) -> Any:
            if set(mode) & set("wax+"):
                self._step("write")
            return real(file, mode, *arguments, **named)

        return call


def disk_full() -> None:
    """Fail as a full disk does."""
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def killed() -> None:
    """End this process as the kernel does when memory runs out: nothing is cleaned up."""
    os.kill(os.getpid(), signal.SIGKILL)
