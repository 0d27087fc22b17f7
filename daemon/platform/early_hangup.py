"""Hang-up signals that come before the daemon can heed them: remembered, where the system would end the process."""

from __future__ import annotations

import signal

_came = False


def remember() -> None:
    """From here on SIGHUP ends nothing; the event loop's own handler takes its place later."""
    signal.signal(signal.SIGHUP, _note)


def came() -> bool:
    """Tell whether one has come since, so that the configuration is to be read again."""
    return _came


def _note(_number: int, _frame: object) -> None:
    global _came  # noqa: PLW0603  # a signal belongs to the whole process
    _came = True
