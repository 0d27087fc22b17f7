"""The history of calibrations: what was replaced, kept beside until there are too many."""

from __future__ import annotations

import errno
import itertools
import os
import re
import shutil
from dataclasses import dataclass
from pathlib import Path

import structlog

from daemon.platform.atomic_file import FOR_THE_GROUP, flush_folder, make_folder, replace_whole
from daemon.platform.clock import utc_now

HISTORY_KEPT = 50
"""Of each kind."""
_NO_LINKS = {errno.EPERM, errno.EOPNOTSUPP, errno.ENOSYS, errno.EMLINK, errno.EXDEV}
"""What a file system answers that has no hard links, or not here."""
log = structlog.get_logger(__name__)


@dataclass(frozen=True)
class Kept:
    """A file of the history, and whether it was put there just now."""

    path: Path
    fresh: bool


class History:
    """The folder of what was replaced. A file in it has the kind and the moment of its retirement as its name."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def add(self, file: Path) -> Kept | None:
        """Keep a second name for a file that is about to be replaced; None if there is no such file.

        What is there already, because a writer was killed after this step, is not kept twice. Raises OSError.
        """
        if not file.exists():
            return None
        make_folder(self._folder)
        kept = self._of(file.stem)
        if kept and _same(kept[-1], file):
            return Kept(kept[-1], fresh=False)
        place = self._free_place(file)
        try:
            os.link(file, place)
        except OSError as exc:
            if exc.errno not in _NO_LINKS:
                raise
            replace_whole(place, lambda beside: shutil.copyfile(file, beside), FOR_THE_GROUP)
        try:
            flush_folder(self._folder)
        except OSError:
            _remove(place)
            raise
        return Kept(place, fresh=True)

    def take_back(self, kept: Kept) -> None:
        """Drop what was added for a replacement that then failed."""
        if kept.fresh:
            _remove(kept.path)

    def prune(self, what: str) -> None:
        """Drop the oldest of a kind beyond `HISTORY_KEPT`; what cannot be dropped stays, and is logged."""
        try:
            too_many = self._of(what)[:-HISTORY_KEPT]
        except OSError as exc:
            log.warning("history_not_pruned", folder=str(self._folder), why=str(exc))
            return
        for old in too_many:
            _remove(old)

    def _of(self, what: str) -> list[Path]:
        """Return what is kept of a kind, oldest first."""
        return sorted(self._folder.glob(f"{what}-*.json"))

    def _free_place(self, file: Path) -> Path:
        """Return a name that is not taken, and sorts behind those of earlier moments."""
        names = (f"{file.stem}-{stamp(utc_now())}{n or ''}{file.suffix}" for n in itertools.count())
        return next(place for name in names if not (place := self._folder / name).exists())


def _same(kept: Path, file: Path) -> bool:
    """Tell whether both say the same; a kept one that cannot be read does not."""
    try:
        return kept.samefile(file) or kept.read_bytes() == file.read_bytes()
    except OSError:
        return False


def _remove(file: Path) -> None:
    try:
        file.unlink(missing_ok=True)
    except OSError as exc:
        log.warning("history_not_pruned", file=str(file), why=str(exc))


def stamp(utc: str) -> str:
    """Return a moment as part of a file name, sortable."""
    return re.sub(r"[^0-9T]", "", utc.split("+", maxsplit=1)[0])
