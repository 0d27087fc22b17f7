"""Pseudo terminal with a link to it: what a serial port of the simulated station is to whoever opens it."""

from __future__ import annotations

import os
import termios
import tty
from pathlib import Path


class LinkedPty:
    """An open pseudo terminal, raw and without waiting. `path` is the device that is opened by its other end."""

    def __init__(self, link: Path | None, what: str) -> None:
        """Open it, and let `link` point to it; `what` it is of, for what is said if that fails.

        Raises:
            OSError: there are no pseudo terminals, or the link cannot be made.

        """
        if link is not None and link.exists() and not link.is_symlink():
            raise FileExistsError(f"{link} exists and is not a symlink; choose another path for the {what}")
        try:
            self._master, self._slave = os.openpty()
        except OSError as error:
            told = f"no pseudo terminal for the {what}: {error.strerror}; is /dev/pts mounted, and has it room?"
            raise OSError(error.errno, told) from error
        self._link: Path | None = None
        self.path = os.ttyname(self._slave)
        try:
            _make_raw(self._slave)
            os.set_blocking(self._master, False)
            if link is not None:
                _replace(link, self.path)
        except OSError:
            self.close()
            raise
        self._link = link

    def fileno(self) -> int:
        """Return the end that is read and written here, for the event loop."""
        return self._master

    def read(self, most: int) -> bytes:
        """Return what has come; BlockingIOError if nothing has."""
        return os.read(self._master, most)

    def write(self, data: bytes) -> int:
        """Write what there is room for, and return how much that was; BlockingIOError if there is none."""
        return os.write(self._master, data)

    def close(self) -> None:
        """Close it; remove the link if it still is ours."""
        if self._link is not None and self._link.is_symlink() and str(self._link.readlink()) == self.path:
            self._link.unlink()
        self._link = None
        os.close(self._master)
        # Held open so far: with no one on the slave side, reading the master would fail instead of waiting.
        os.close(self._slave)


def _make_raw(descriptor: int) -> None:
    tty.setraw(descriptor)
    settings = termios.tcgetattr(descriptor)
    settings[4] = settings[5] = termios.B115200
    termios.tcsetattr(descriptor, termios.TCSANOW, settings)


def _replace(link: Path, target: str) -> None:
    """Set a link in one step: who waits for the path never finds a half-made one."""
    fresh = link.with_name(f"{link.name}.{os.getpid()}")
    fresh.symlink_to(target)
    fresh.replace(link)
