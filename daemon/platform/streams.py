"""Standard streams of a process that was started without some of them, as by `>&-` or a careless supervisor."""

from __future__ import annotations

import os
import sys
from pathlib import Path


def open_streams() -> None:
    """Put the null device where a standard stream is closed, in their order.

    Else the next file or socket that is opened would be the standard output, and what is printed would go into it.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open(mode, encoding="utf-8"))  # noqa: SIM115  # for the whole life
