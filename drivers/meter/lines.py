"""Lines of text out of a stream of bytes: collected as they come, waited for with a deadline."""

from __future__ import annotations

import asyncio
from collections import deque

from drivers.deadline import Deadline

LONGEST = 65_536
"""More without an end is no answer."""


class Lost(Exception):
    """The stream ended."""


class Overlong(Exception):
    """Bytes came, and no end of a line."""


class Lines:
    """Hold what has come: whole lines, and the beginning of the next one."""

    def __init__(self, terminator: str) -> None:
        self._end = terminator[-1:].encode()
        self._buffer = bytearray()
        self._lines: deque[str] = deque()
        self._came = asyncio.Event()
        self._why: str | None = None

    @property
    def waiting(self) -> bool:
        """Tell whether something came that nobody has taken."""
        return bool(self._lines or self._buffer)

    @property
    def begun(self) -> str:
        """Return the beginning of a line whose end has not come."""
        return _text(bytes(self._buffer))

    @property
    def lost(self) -> bool:
        """Tell whether the stream has ended."""
        return self._why is not None

    def feed(self, data: bytes) -> None:
        """Take bytes that came. An endless line is cut: its beginning is enough to tell what it is."""
        *whole, rest = (bytes(self._buffer) + data).split(self._end)
        self._lines.extend(_text(line) for line in whole)
        while len(self._lines) > LONGEST // 64:
            self._lines.popleft()
        self._buffer = bytearray(rest[: LONGEST + 1])
        self._came.set()

    def end(self, why: str) -> None:
        """Note that the stream has ended."""
        self._why = self._why or why
        self._came.set()

    def drop(self) -> list[str]:
        """Throw away what came, and return its whole lines."""
        dropped = list(self._lines)
        self._lines.clear()
        self._buffer.clear()
        return dropped

    async def next(self, deadline: Deadline) -> str:
        """Return the next line without its end, and without blanks around it.

        Raises:
            TimeoutError: none in time.
            Lost: the stream has ended.
            Overlong: a line has no end.

        """
        async with asyncio.timeout(deadline.remaining_s):
            while not self._lines:
                if len(self._buffer) > LONGEST:
                    raise Overlong
                if self._why is not None:
                    raise Lost(self._why)
                self._came.clear()
                await self._came.wait()
        return self._lines.popleft()


def _text(data: bytes) -> str:
    return data.decode("ascii", errors="replace").strip(" \t\r\n\0")
