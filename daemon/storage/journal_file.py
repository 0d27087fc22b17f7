"""Journal file: the open SQLite file, whether it still lies where it was opened, and putting it back.

SQLite goes on writing into a file that somebody has deleted, and everything is gone at the next start. So before and
after each piece of work the file at the path is compared with the one that was opened. Used by one thread.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path
from typing import NamedTuple, TypeVar

from daemon.platform.atomic_file import flush_folder
from daemon.storage.journal_schema import close_file, is_damage, move_aside, open_file
from daemon.storage.write_ahead_log import HEAD_BYTES, LogSum

ROOM_BYTES = 256 * 1024
"""A job is taken only while there is so much room: its looks and its result need some 20 kB."""
GO_ON_BYTES = 2 * ROOM_BYTES
T = TypeVar("T")


class FileLost(OSError):
    """The file is not the one that was opened; only a person may say that work goes on."""


class NotAFile(OSError):
    """What lies at the path is no file, and nobody can open it: a folder, a pipe, a link to nothing."""


class NoRoom(OSError):
    """The disk is as good as full."""


class _Seen(NamedTuple):
    """What tells a file from another, and whether somebody else wrote into it."""

    device: int
    inode: int
    size: int = 0
    changed_ns: int = 0


class JournalFile:
    """The file at one path. Methods raise sqlite3.Error or OSError."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._wal = path.with_name(f"{path.name}-wal")
        self._db: sqlite3.Connection | None = None
        self._seen: tuple[_Seen, _Seen] | None = None
        self._log_head = b""
        self._log_sum = LogSum(self._wal)
        self._log_changed = False
        self._damaged = False
        self.moved_to: Path | None = None
        self.moved_because = ""
        self.first_seq = 0
        """The first free event number by this file; 0 as long as nobody could read it."""

    @property
    def is_writable(self) -> bool:
        """Whether it was opened for writing."""
        return self._seen is not None

    def open(self) -> None:
        """Open or create it for writing; a damaged one is moved aside: see `moved_to`."""
        self._require_file()
        opened = open_file(self._path)
        self._close_silently()
        self._db, self.first_seq, self._damaged = opened.db, max(self.first_seq, opened.next_seq), False
        if opened.moved_to is not None:
            self.moved_to, self.moved_because = opened.moved_to, opened.why
        self._seen, self._log_head, self._log_changed = self._look(), _head(self._wal), False
        self._log_sum.forget()
        self._log_sum.follow()

    def open_to_read(self) -> None:
        """Open it as it is, for a disk on which nothing can be written."""
        self._require_file()
        # Even a reader wants to write beside a WAL; without one the file can be read as if it never changed.
        ways = ("mode=ro", "mode=ro&immutable=1") if not _seen(self._wal).size else ("mode=ro",)
        errors: list[sqlite3.Error] = []
        for way in ways:
            uri = f"{self._path.absolute().as_uri()}?{way}"
            try:
                self._db, self.first_seq = _open_reader(uri)
                return
            except sqlite3.Error as exc:
                errors.append(exc)
        raise errors[-1]

    def _require_file(self) -> None:
        """Raise `NotAFile` if something else lies at the path; to open a pipe would wait without end."""
        if self._path.exists():
            if not self._path.is_file():
                raise NotAFile(f"{self._path} is no file")
        elif self._path.is_symlink():
            raise NotAFile(f"{self._path} is a link to nothing")

    def do(self, work: Callable[[sqlite3.Connection], T]) -> T:
        """Do a piece of work; raise `FileLost` if it went, or would go, into another file than the one at the path."""
        if self._db is None:
            raise sqlite3.OperationalError("it is not open")
        self.look_after()
        try:
            done = work(self._db)
        except sqlite3.Error as exc:
            self._damaged = self._damaged or is_damage(exc)
            self._log_sum.forget()
            raise
        finally:
            self._note()
        return done

    def look_after(self) -> None:
        """Raise `FileLost` if the file at the path is not the one that was opened, or somebody else wrote into it."""
        if self._seen is None:
            return
        for was, now, path in zip(self._seen, self._look(), (self._path, self._wal), strict=True):
            if now[:2] != was[:2]:
                raise FileLost(f"{path} was deleted or replaced while the daemon was at work")
            if now != was and path == self._path:
                raise FileLost(f"{path} was written by somebody else while the daemon was at work")
        if self._log_is_spoilt():
            raise FileLost(f"{self._wal} was written over while the daemon was at work")

    def verify_log(self) -> None:
        """Read the whole write-ahead log; raise `FileLost` if a byte of it is not what was written."""
        self._log_changed = self._log_changed or (self.is_writable and not self._log_sum.is_kept())
        self.look_after()

    def _note(self) -> None:
        """Remember how the file is after own work; raise `FileLost` if it went into another."""
        if self._seen is None:
            return
        now = self._look()
        for was, is_now, path in zip(self._seen, now, (self._path, self._wal), strict=True):
            if is_now[:2] != was[:2]:
                raise FileLost(f"{path} was deleted or replaced while the daemon was at work")
        if now[1] != self._seen[1]:
            self._log_sum.follow()
        self._seen, self._log_head = now, _head(self._wal)

    def _look(self) -> tuple[_Seen, _Seen]:
        return _seen(self._path), _seen(self._wal)

    def require_room(self, needed: int = ROOM_BYTES) -> None:
        """Raise `NoRoom` if a result might not fit any more."""
        disk = os.statvfs(next(folder for folder in self._path.absolute().parents if folder.is_dir()))
        if disk.f_bavail * disk.f_frsize < needed:
            raise NoRoom("there is no room on the disk")

    def go_on(self) -> None:
        """Try to work again after a failure: enough room, and a write that succeeds."""
        self.require_room(GO_ON_BYTES)
        if not self.is_writable:
            self.open()
        self.do(lambda db: db.execute("INSERT INTO kept VALUES ('room', ?)", ("x" * ROOM_BYTES,)))
        self.do(lambda db: db.execute("DELETE FROM kept WHERE key='room'"))

    # --- mending ----------------------------------------------------------------------------------------------

    def mend(self) -> None:
        """Put the journal in order where a person asked for it: what was deleted is put back, damage moved aside."""
        lost = self._lost()
        if lost and self._is_unlinked() and self._db is not None and not self._damaged:
            self._put_back(self._db)
        elif lost and self._log_is_spoilt() and self._seen is not None and _seen(self._path) == self._seen[0]:
            self._go_back()
        elif lost and self._is_only_touched():
            self._seen, self._log_head = self._look(), _head(self._wal)
        elif lost:
            self._begin_again("written by somebody else while the daemon was at work")
        elif self._damaged or not self.is_writable:
            self._close_silently()
            self.open()
        self.go_on()

    def rescue(self) -> None:
        """Put back a file that was deleted, so that a kill before the person comes loses nothing.

        Where another file lies in its place, that waits for `mend`.
        """
        if self._db is not None and not self._damaged and self._is_unlinked() and not self._path.exists():
            self._put_back(self._db)

    def _lost(self) -> bool:
        try:
            self.look_after()
        except FileLost:
            return True
        return False

    def _is_unlinked(self) -> bool:
        """Tell whether the open file is whole, only not at its path any more."""
        return self._seen is not None and any(
            was[:2] != now[:2] for was, now in zip(self._seen, self._look(), strict=True)
        )

    def _log_is_spoilt(self) -> bool:
        """Tell whether the log is shorter than it was left, begins otherwise or was found changed: it only grows."""
        if self._seen is None:
            return False
        was, now = self._seen[1], _seen(self._wal)
        return self._log_changed or now.size < was.size or (was.size > 0 and _head(self._wal) != self._log_head)

    def _is_only_touched(self) -> bool:
        """Tell whether the file is sound and as long as it was, though the time of its last change is another."""
        if self._seen is None or _seen(self._path).size != self._seen[0].size:
            return False
        try:
            fresh = sqlite3.connect(f"{self._path.absolute().as_uri()}?mode=ro", uri=True)
            try:
                return bool(fresh.execute("PRAGMA quick_check(1)").fetchone()[0] == "ok")
            finally:
                fresh.close()
        except sqlite3.Error:
            return False

    def _put_back(self, db: sqlite3.Connection) -> None:
        """Write what is in the open file to the path again; what lies there now is moved aside."""
        self._path.parent.mkdir(parents=True, exist_ok=True)  # perhaps the folder was deleted, too
        whole = self._path.with_name(f"{self._path.name}-whole")
        whole.unlink(missing_ok=True)
        copy = sqlite3.connect(whole)
        try:
            db.backup(copy)
        finally:
            copy.close()
        with whole.open("rb") as file:
            os.fsync(file.fileno())
        self._part()
        whole.replace(self._path)
        flush_folder(self._path.parent)
        self.open()

    def _go_back(self) -> None:
        """Go on with the file as it is on the disk, and with what SQLite takes of its log: whole, up to the damage.

        What has both is moved aside, and nothing that SQLite still holds of the log gets into the new file.
        """
        before = self._path.with_name(f"{self._path.name}-before")
        shutil.copyfile(self._path, before)
        with suppress(FileNotFoundError):
            shutil.copyfile(self._wal, before.with_name(f"{before.name}-wal"))
        with closing(sqlite3.connect(before)) as taken:
            taken.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        with before.open("rb") as file:
            os.fsync(file.fileno())
        moved = self._part(keep_own=True)
        before.replace(self._path)
        flush_folder(self._path.parent)
        self.open()
        why = "its write-ahead log was written over while the daemon was at work: what was written last is lost"
        self.moved_to, self.moved_because = moved or self.moved_to, why

    def _begin_again(self, why: str) -> None:
        """Move aside what nobody can trust, and begin a new journal."""
        moved = self._part(keep_own=True)
        self.open()
        self.moved_to, self.moved_because = moved, why

    def _part(self, *, keep_own: bool = False) -> Path | None:
        """Let go of the open file and clear the path; return where what lay there was moved, None if nothing did."""
        seen = self._seen
        if not keep_own and seen is not None and _seen(self._wal)[:2] == seen[1][:2]:
            self._wal.unlink()  # what it holds was copied; beside another file it would spoil that one
        moved = None
        own = seen is not None and _seen(self._path)[:2] == seen[0][:2]
        if self._path.exists() and (keep_own or not own):
            moved = move_aside(self._path)
        self._close_silently()
        for tail in ("-wal", "-shm"):
            self._path.with_name(self._path.name + tail).unlink(missing_ok=True)
        return moved

    # --- the end ----------------------------------------------------------------------------------------------

    def close(self) -> None:
        """Close it in order; one that is damaged, replaced or read-only is left as it is."""
        self.rescue()
        if self._db is not None and self.is_writable and not self._damaged and not self._lost():
            close_file(self._db)
            self._db = None
        self._close_silently()

    def _close_silently(self) -> None:
        """Close whatever is open; a failing close of a file in trouble says nothing new."""
        if self._db is not None:
            with suppress(sqlite3.Error):
                self._db.close()
        self._db, self._seen = None, None


def _open_reader(uri: str) -> tuple[sqlite3.Connection, int]:
    """Return a connection that only reads, and the first free event number by its file."""
    db = sqlite3.connect(uri, uri=True, isolation_level=None, check_same_thread=False)
    try:
        row = db.execute("SELECT value FROM meta WHERE key='next_seq'").fetchone()
    except BaseException:
        db.close()
        raise
    return db, int(row[0]) if row else 1


def _seen(path: Path) -> _Seen:
    try:
        found = path.stat()
    except OSError:
        return _Seen(0, 0)
    return _Seen(found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns)


def _head(log: Path) -> bytes:
    """Return the head of a write-ahead log: it stays as long as the log only grows. No lock of SQLite's is on it."""
    try:
        with log.open("rb") as file:
            return file.read(HEAD_BYTES)
    except OSError:
        return b""
