"""Standard streams of a process: some may be closed, as by `>&-` or a careless supervisor, some know few letters."""

from __future__ import annotations

import io
import os
import sys
from pathlib import Path


def open_streams() -> None:
    """Put the null device where a standard stream is closed, in their order.

    Else the next file or socket that is opened would be the standard output, and what is printed would go into it.
    What a terminal has no letter for is written out by its number: a name with such a letter ends no command.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open(mode, encoding="utf-8"))  # noqa: SIM115  # for the whole life
    for stream, errors in ((sys.stdin, "surrogateescape"), (sys.stdout, "backslashreplace")):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=errors)
