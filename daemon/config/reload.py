"""Reload of the configuration: what may change while the daemon runs, and what needs a restart.

The file is read and checked whole before anything is touched. If one value is wrong, or one value changed that only a
restart can change, nothing of it is taken over and the daemon goes on with what it had.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from pathlib import Path

import structlog

from daemon.config.model import Config, ConfigError, load_config
from daemon.domain.board import Board

LIVE = frozenset(
    {
        "api.heartbeat_s",
        "api.max_message_bytes",
        "api.queue_length",
        "api.queue_per_client",
        "api.rate_burst",
        "api.rate_per_s",
        "board",
        "brush",
        "control_point",
        "head",
        "ladder",
        "maintenance",
        "meter.channels",
        "meter.contact_channel",
        "meter.ground_net",
        "pin",
        "reference",
        "servo",
        "station.needle",
        "station.pictures",
        "station.pictures_quota_mb",
        "touch",
    }
)
"""What a running daemon takes over; all else was given to a device, a socket or a file when it was opened."""
SETTLE_S = 0.05
"""Signals that come this close together ask for one reading."""
log = structlog.get_logger(__name__)


@dataclass(frozen=True)
class Change:
    """A configuration that may be taken over, the board it names, and which of its values are new."""

    config: Config
    board: Board
    changed: tuple[str, ...]


def read_change(path: Path, old: Config) -> Change:
    """Read the file and compare; raise `ConfigError` with every problem, also if it cannot be taken over live."""
    new = load_config(path)
    changed = differences(old, new)
    problems = [
        (name, "changed, and only a restart can change it: `systemctl restart reprobe`")
        for name in changed
        if not _is_live(name)
    ]
    try:
        board = Board.load(new.board.file)
    except ValueError as exc:
        problems.append(("board.file", str(exc)))
    if problems:
        raise ConfigError(path, problems)
    return Change(new, board, changed)


def differences(old: Config, new: Config) -> tuple[str, ...]:
    """Return `section` or `section.field` of everything that differs; an optional section that comes or goes is one."""
    names: list[str] = []
    for section in type(old).model_fields:
        before, after = getattr(old, section), getattr(new, section)
        if before == after:
            continue
        fields = getattr(type(before), "model_fields", None)
        if fields is None or type(before) is not type(after):
            names.append(section)
        else:
            names += [f"{section}.{field}" for field in fields if getattr(before, field) != getattr(after, field)]
    return tuple(names)


def _is_live(name: str) -> bool:
    return name in LIVE or name.partition(".")[0] in LIVE


class Reloader:
    """Take over the file's configuration each time it is asked for, between two jobs; one at a time."""

    def __init__(
        self,
        path: Path | None,
        current: Callable[[], Config],
        exclusive: Callable[[], AbstractAsyncContextManager[object]],
        take_over: Callable[[Change], None],
        tell: Callable[[str, dict[str, object]], Awaitable[None]],
    ) -> None:
        """Take the file (None: there is none to read again) and the daemon's ways.

        `exclusive()` is held while nothing may run, `take_over` puts the change in force, `tell(what, facts)` says
        how it went: `begun`, `waits`, `refused`, `taken`.
        """
        self._path, self._current, self._exclusive = path, current, exclusive
        self._take_over, self._tell = take_over, tell
        self._asked = asyncio.Event()

    def ask(self) -> None:
        """Ask for a reading; called by the signal."""
        self._asked.set()

    async def run(self, *, busy: Callable[[], bool]) -> None:
        """Serve until cancelled."""
        while True:
            await self._asked.wait()
            await asyncio.sleep(SETTLE_S)
            self._asked.clear()
            await self._once(busy)

    async def _once(self, busy: Callable[[], bool]) -> None:
        await self._tell("begun", {})
        if await self._checked() is None:
            return
        if busy():
            await self._tell("waits", {})
        async with self._exclusive():
            # Read once more: file and board may be others by now.
            change = await self._checked()
            if change is not None:
                self._take_over(change)
                log.info("configuration_taken_over", path=str(self._path), changed=change.changed)
                await self._tell("taken", {"changed": list(change.changed)})

    async def _checked(self) -> Change | None:
        """Read and check the file; say what is wrong with it."""
        problems = [("(file)", "the daemon was started without one")]
        try:
            if self._path is not None:
                return await asyncio.to_thread(read_change, self._path, self._current())
        except ConfigError as exc:
            problems = exc.placed()
        except Exception as exc:  # a file that cannot be read never ends a daemon that works well without it
            log.exception("configuration_not_read", path=str(self._path))
            problems = [("(file)", f"reading it failed: {type(exc).__name__}: {exc}"[:300])]
        log.error("configuration_refused", path=str(self._path), problems=problems)
        await self._tell("refused", {"problems": [list(problem) for problem in problems]})
        return None
