"""Subprocess that draws a page: the memory it needs is gone with it."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Sequence

OK, NOT_WRITTEN, WRONG = 0, 1, 2
"""Exit status: written; a file could not be read or written; the call, or what it names, is wrong."""
SAYS = "reprobe report: "
"""What such a process puts before its words."""


async def draw(module: str, arguments: Sequence[str], within_s: float, nicer: int = 0) -> tuple[int, str]:
    """Run a module of this package; return its exit status and what it said, both 0 and empty if all went well.

    `nicer`: how much less of the processor it gets. The process never outlives this call, however the call ends.
    """
    try:
        process = await asyncio.create_subprocess_exec(
            "nice", "-n", str(nicer), sys.executable, "-m", module, *arguments,
            stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.DEVNULL, stderr=asyncio.subprocess.PIPE,
        )  # fmt: skip
    except OSError as exc:  # the limit of processes, or of memory
        return NOT_WRITTEN, f"the process that draws the page cannot be started: {exc}"
    try:
        _, words = await asyncio.wait_for(process.communicate(), within_s)
    except TimeoutError:
        return NOT_WRITTEN, "drawing the page took too long"
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    return int(process.returncode or 0), words.decode(errors="replace").strip().removeprefix(SAYS)
