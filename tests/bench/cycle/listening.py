"""Daemon whose serial line is written down: every byte that passes, with the time; and what its jobs do meanwhile.

    python -m tests.bench.cycle.listening FILE run --config station.toml

Each line of FILE is a JSON list: seconds of the monotonic clock, "sent" or "received", and the bytes in hex. In
marks.jsonl beside it: seconds, "state", its name; and seconds, "frame", begin of its exposure, its length, s.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from daemon.cli import main
from daemon.platform.clock import Stopwatch
from daemon.station.frames import Frames
from drivers.bus import ModbusBus
from drivers.camera import Frame
from tests.bench.cycle.timeline import MARKS


def listen(path: Path) -> None:
    """Have every line that is opened from now on written down."""
    file = path.open("a", encoding="ascii", buffering=1)
    real_open = ModbusBus.open.__func__  # type: ignore[attr-defined]

    def tap(direction: str, data: bytes) -> None:
        file.write(json.dumps([round(time.monotonic(), 6), direction, data.hex()]) + "\n")

    async def opened(cls: type[ModbusBus], *arguments: Any, **options: Any) -> Any:
        return await real_open(cls, *arguments, **{**options, "tap": tap})

    ModbusBus.open = classmethod(opened)  # type: ignore[assignment, method-assign]


def mark(path: Path) -> None:
    """Have the states of jobs, and the frames of their looks, written down from now on."""
    file = path.open("a", encoding="ascii", buffering=1)

    def note(*what: object) -> None:
        file.write(json.dumps([round(time.monotonic(), 6), *what]) + "\n")

    enter = Stopwatch.enter

    def entered(watch: Stopwatch, state: str) -> None:
        note("state", state)
        enter(watch, state)

    def noting(taking: Callable[..., Awaitable[Frame]]) -> Callable[..., Awaitable[Frame]]:
        async def taken(*arguments: Any) -> Frame:
            frame = await taking(*arguments)
            note("frame", round(frame.exposure_start_s, 6), frame.exposure_s)
            return frame

        return taken

    Stopwatch.enter = entered  # type: ignore[method-assign]
    Frames.take, Frames.arrived = noting(Frames.take), noting(Frames.arrived)  # type: ignore[method-assign,assignment]


if __name__ == "__main__":
    record = Path(sys.argv.pop(1))
    listen(record)
    mark(record.with_name(MARKS))
    main()
