"""Common parts of both report commands: how they speak, and where matplotlib keeps its settings."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NoReturn

from daemon.platform.subprocess import NOT_WRITTEN, OK, SAYS, WRONG

__all__ = ["NOT_WRITTEN", "OK", "WRONG", "Parser", "own_settings", "say"]


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line."""

    def error(self, message: str) -> NoReturn:
        """Leave with the status of a wrong call."""
        sys.exit(say(message, WRONG))


def say(message: str, status: int) -> int:
    """Say on stderr, in one line, why nothing was written; return the exit status."""
    sys.stderr.write(SAYS + " ".join(message.split()) + "\n")
    return status


@contextmanager
def own_settings() -> Iterator[None]:
    """Let matplotlib keep its settings in a folder for once; to be entered before it is imported.

    A service's user has no home to keep them in; it would warn and look for a place by itself.
    """
    with tempfile.TemporaryDirectory(prefix="reprobe-report-") as folder:
        os.environ.setdefault("MPLCONFIGDIR", folder)
        yield
