"""Writer of the journal: one thread owns the connection, and numbers the events; trouble is said, and gone on from.

The event loop never waits for the disk, and writes keep their order. `seq` numbers every published event; numbers are
handed out from reserved blocks, so that they never repeat, not even after a crash.

A journal that cannot be written is in trouble and says so; `check` tries to go on when there is room again. One that
was deleted or replaced waits for `mend`, for what it held may be lost.
"""

from __future__ import annotations

import asyncio
import sqlite3
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Self, TypeVar

import structlog

from daemon.domain.errors import Fault, FaultCode
from daemon.storage.event_numbers import BLOCK, SPARE, EventNumbers
from daemon.storage.journal_file import FileLost, JournalFile, NotAFile
from daemon.storage.journal_schema import is_damage, set_meta
from daemon.storage.pinned_state import PinnedState

SEQ_BLOCK = BLOCK
VERIFY_LOG_EVERY_S = 10.0
"""So often the whole write-ahead log is read: some 4 MB at most, which takes some ms beside the event loop."""
NEXT_SEQ = "next_seq"
LOST_ADVICE = "`reset` writes the journal to its place again; find out who deleted or replaced it"
FULL_ADVICE = "free disk space; the daemon goes on by itself"
PLACE_ADVICE = "move away what lies there; the daemon goes on by itself"
DENIED_ADVICE = "see that its folder is there and that the daemon's user may write; the daemon goes on by itself"
DAMAGE_ADVICE = "`reset` moves the damaged file aside and begins a new journal"
_DENIED = frozenset({sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_PERM, sqlite3.SQLITE_READONLY})
T = TypeVar("T")
log = structlog.get_logger(__name__)


class JournalWriter:
    """Own the file and its thread; what is written is said by who inherits. Every method belongs to one event loop."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = JournalFile(path)
        self._pinned = PinnedState(path.with_suffix(".pinned"))
        self._writer = ThreadPoolExecutor(max_workers=1, thread_name_prefix="journal")
        self._numbers = EventNumbers()
        self._reserving: asyncio.Task[None] | None = None
        self._trouble: Fault | None = None
        self._goes_on_by_itself = True
        self._verify_at_s = 0.0
        self.troubled = asyncio.Event()
        """Set when trouble begins; who looks after the journal waits for it and clears it."""

    @classmethod
    async def open(cls, path: Path) -> Self:
        """Open or create the journal; one that cannot be written is in trouble: see `trouble`.

        A damaged file is moved aside and a new one begun: see `moved_to`. One of a newer version is refused: `Fault`.
        """
        journal = cls(path)
        try:
            await journal._in_writer(journal._open)
        except sqlite3.NotSupportedError as exc:
            journal._writer.shutdown()
            advice = "install the newer program again, or move the file aside to begin a new journal"
            raise Fault(FaultCode.JOURNAL_FAILED, f"{path}: {exc}", advice=advice) from exc
        await journal.reserve_seqs()
        return journal

    def _open(self) -> None:
        with suppress(OSError):
            self._pinned.load()
        self._numbers.begin(int(self._pinned.get(NEXT_SEQ) or 0))
        try:
            self._file.open()
        except sqlite3.NotSupportedError:
            raise
        except (sqlite3.Error, OSError) as exc:
            self._note_trouble(exc)
            with suppress(sqlite3.Error, OSError):
                self._file.open_to_read()
        self._numbers.begin(self._file.first_seq)

    async def close(self) -> None:
        """Give unused numbers back, write all and close; a file found damaged is left to be looked through."""
        if self._reserving is not None:
            await self._reserving
        try:
            await self._in_writer(self._close)
        finally:
            self._writer.shutdown()

    def _close(self) -> None:
        try:
            self._write_down(self._numbers.upcoming)
            self._file.close()
        except (sqlite3.Error, OSError) as exc:
            log.error("journal_not_closed", error=str(exc))

    # --- trouble ----------------------------------------------------------------------------------------------

    @property
    def trouble(self) -> Fault | None:
        """What keeps the journal from being written, None while it is well."""
        return self._trouble

    @property
    def moved_to(self) -> Path | None:
        """Where a predecessor that could not be read was put, None if there was none."""
        return self._file.moved_to

    @property
    def moved_because(self) -> str:
        """Why it was put there."""
        return self._file.moved_because

    async def check(self) -> Fault | None:
        """Look whether the journal is in its place and has room; in trouble, try to go on. Return what is wrong."""
        if self._trouble is None:
            with suppress(Fault):
                await self._run(lambda _db: self._look())
            if self._trouble is None:
                return None
        if self._goes_on_by_itself:
            await self._try(self._file.go_on)
        else:
            with suppress(sqlite3.Error, OSError):
                await self._in_writer(self._file.rescue)
        return self._trouble

    def _look(self) -> None:
        """Raise if there is no room, or now and then if the write-ahead log was changed by somebody else."""
        self._file.require_room()
        if time.monotonic() >= self._verify_at_s:
            self._file.verify_log()
            self._verify_at_s = time.monotonic() + VERIFY_LOG_EVERY_S

    async def mend(self) -> Fault | None:
        """Do what a person's `reset` asks for: put back what was deleted, begin again where it is damaged."""
        if self._trouble is not None:
            await self._try(self._file.mend)
        return self._trouble

    async def _try(self, way: Callable[[], None]) -> None:
        """Leave the trouble if one way out of it succeeds."""
        try:
            await self._in_writer(way)
        except (sqlite3.Error, OSError) as exc:
            self._note_trouble(exc)
            return
        self._numbers.begin(self._file.first_seq)
        self._trouble, self._goes_on_by_itself = None, True
        await self.reserve_seqs()

    def _note_trouble(self, exc: Exception) -> Fault:
        """Remember what is wrong; the first cause stays, unless the file was lost or is damaged."""
        by_itself = not (isinstance(exc, FileLost) or (isinstance(exc, sqlite3.Error) and is_damage(exc)))
        advice = _advice(exc)
        fault = Fault(FaultCode.JOURNAL_FAILED, f"the journal cannot be written: {exc}"[:300], advice=advice)
        if self._trouble is None or (self._goes_on_by_itself and not by_itself):
            self._trouble, self._goes_on_by_itself = fault, by_itself
            log.error("journal_in_trouble", error=str(exc), advice=advice)
        return fault

    # --- numbers ----------------------------------------------------------------------------------------------

    async def reserve_seqs(self) -> None:
        """Write ahead that a block of event numbers is taken, so that none is ever given twice.

        Done before each job, with each heartbeat, and whenever half a block is used. Never raises: what cannot be
        written is not reserved, and no number beyond is given.
        """
        end = self._numbers.wanted
        if end is not None and self._numbers.upcoming > 0 and await self._in_writer(lambda: self._write_down(end)):
            self._numbers.reserved(end)

    def _write_down(self, next_seq: int) -> bool:
        """Write the first free number to both places it is looked for; return whether one of them has it."""
        written = False
        try:
            self._pinned.store(NEXT_SEQ, next_seq)
            written = True
        except OSError as exc:
            log.warning("numbers_not_pinned", error=str(exc))
        if self._file.is_writable:
            try:
                self._file.do(lambda db: set_meta(db, "next_seq", next_seq))
                written = True
            except (sqlite3.Error, OSError) as exc:
                self._note_trouble(exc)
        return written

    def take_seq(self) -> int:
        """Return the next event number; raise `Fault` if none is reserved. A block that gets short is followed up."""
        if self._numbers.wanted is not None and (self._reserving is None or self._reserving.done()):
            self._reserving = asyncio.create_task(self.reserve_seqs(), name="event numbers")
        return _number(self._numbers.take(SPARE))

    def lend_seq(self) -> int:
        """Return the number for an event that has yet to be written; `settle_seq` says whether it was."""
        return _number(self._numbers.lend())

    def settle_seq(self, *, used: bool) -> None:
        """Keep the number that was lent, or take it back; until then nobody may take another."""
        self._numbers.settle(used=used)

    @property
    def upcoming_seq(self) -> int:
        """The number the next event will carry."""
        return self._numbers.upcoming

    # --- work -------------------------------------------------------------------------------------------------

    async def _run(self, work: Callable[[sqlite3.Connection], T]) -> T:
        """Do `work` in the writer thread; a failing disk is a `Fault`, and trouble."""
        try:
            return await self._in_writer(lambda: self._do(work))
        except sqlite3.IntegrityError as exc:
            raise Fault(FaultCode.JOURNAL_FAILED, f"the journal answers: {exc}") from exc
        except (sqlite3.Error, OSError) as exc:
            fault = self._note_trouble(exc)
            self.troubled.set()
            raise fault from exc

    def _do(self, work: Callable[[sqlite3.Connection], T]) -> T:
        """Do `work`; in the writer thread."""
        return self._file.do(work)

    async def _in_writer(self, work: Callable[[], T]) -> T:
        return await asyncio.get_running_loop().run_in_executor(self._writer, work)


def _number(found: int | None) -> int:
    if found is None:
        raise Fault(FaultCode.JOURNAL_FAILED, "no event number is reserved, and none can be while the disk is full")
    return found


def _advice(exc: Exception) -> str:
    """Return what to do about a journal in trouble."""
    if isinstance(exc, FileLost):
        return LOST_ADVICE
    if isinstance(exc, NotAFile):
        return PLACE_ADVICE
    if isinstance(exc, sqlite3.Error):
        if is_damage(exc):
            return DAMAGE_ADVICE
        if int(getattr(exc, "sqlite_errorcode", 0)) & 0xFF in _DENIED:
            return DENIED_ADVICE
    return FULL_ADVICE
