"""Image archive of the jobs: a ring of folders on disk with a quota."""

from __future__ import annotations

import asyncio
import errno
import hashlib
import json
import os
import re
import stat
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Literal

import cv2
import structlog

from daemon.domain.point_test import PointRecord, PointVerdict
from daemon.domain.results import JobResult
from daemon.jobs.context import JobContext, PointLooks
from daemon.platform.finite_json import to_json
from daemon.platform.plain_file import read_small
from daemon.station.board_view import BoardSeen
from daemon.station.station import LookResult
from daemon.wire.operations.jobs import AnyJob, Look
from drivers.camera.contract import Pixels
from vision import Tip
from vision.annotate import BoardLook, draw_board, draw_control_point, draw_landing, draw_test_points, draw_tip

log = structlog.get_logger(__name__)
JPEG_QUALITY = 92
LONGEST_NAME = 64
NUMBERS = "result.json"
MOST_NUMBERS_BYTES = 16_000_000
LOOKS, KINDS = ("before", "after"), ("white", "red", "tip", "cross", "pads", "board", "landing")
OWN = re.compile(rf"result\.json|({'|'.join(LOOKS)})-({'|'.join(KINDS)})\.jpg")
"""Names of the files in a job's folder."""


class ImageArchive:
    """Keep white, red and the annotated picture of a job's first and last look."""

    def __init__(self, folder: Path, which: Literal["failed", "all", "none"], quota_mb: float) -> None:
        self._folder = folder
        self._which = which
        self._quota_bytes = int(quota_mb * 1e6)
        self.full: str | None = None
        """Why pictures are not kept at present; None when they are."""

    def adopt(self, which: Literal["failed", "all", "none"], quota_mb: float) -> None:
        """Take over other settings; a smaller quota is kept to from the next pictures on."""
        self._which, self._quota_bytes = which, int(quota_mb * 1e6)

    def folder_for(self, request: AnyJob, *, failed: bool) -> Path | None:
        """Return where this job's pictures go, or None if they are not wanted."""
        asked = isinstance(request, Look) and request.pictures
        if asked or self._which == "all" or (self._which == "failed" and failed):
            return self._folder / _folder_name(request.id)
        return None

    def folder_for_point(self, job_id: str, record: PointRecord) -> Path | None:
        """Return where the pictures of one point of a job go, or None if they are not wanted, or there are none."""
        failed = record.verdict is not PointVerdict.PASS_FIRST
        wanted = record.looks > 0 and (self._which == "all" or (self._which == "failed" and failed))
        return self._folder / _folder_name(point_pictures_id(job_id, record.point)) if wanted else None

    async def keep(self, folder: Path, job: JobContext, result: JobResult) -> None:
        """Write the pictures, then drop the oldest folders beyond the quota; a full disk only stops the keeping."""
        before, after = job.pictured(failed=not result.ok)
        await self._keep(folder, {"before": before, "after": after}, result.model_dump_json(indent=1))

    async def keep_point(self, folder: Path, job_id: str, looks: PointLooks, record: PointRecord) -> None:
        """Write the pictures of one point, as those of a job."""
        numbers = {"id": point_pictures_id(job_id, record.point), **record.model_dump(mode="json")}
        before, after = looks
        await self._keep(folder, {"before": before, "after": after}, to_json(numbers, indent=1))

    async def _keep(self, folder: Path, looks: dict[str, LookResult | None], numbers: str) -> None:
        wanted = {name: look for name, look in looks.items() if look is not None}
        try:
            await asyncio.to_thread(self._write, folder, wanted, numbers)
            self.full = None
        except OSError as exc:
            self.full = f"{exc.strerror}: {folder}"
            log.error("pictures_not_kept", folder=str(folder), error=str(exc))

    async def hashes_of(self, job_id: str) -> dict[str, str]:
        """Return which pictures of a job are kept, such as `before-white`, each with its file's SHA-256, hexadecimal.

        None are of a job that is unknown.
        """

        def read() -> dict[str, str]:
            folder = self._folder / _folder_name(job_id)
            found = {which: _read_plain(folder, f"{which}.jpg") for which in _kept(folder)}
            return {which: hashlib.sha256(jpeg).hexdigest() for which, jpeg in found.items() if jpeg is not None}

        return await asyncio.to_thread(read)

    async def picture(self, job_id: str, which: str) -> bytes | None:
        """Return one kept picture, JPEG; None if there is none of that name."""
        name = f"{which}.jpg"
        if not OWN.fullmatch(name):
            return None
        return await asyncio.to_thread(_read_plain, self._folder / _folder_name(job_id), name)

    def _write(self, folder: Path, looks: dict[str, LookResult], numbers: str) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        if folder.is_symlink():
            raise OSError(errno.ELOOP, "a link is in the place of the pictures' folder")
        _write_plain(folder / NUMBERS, numbers.encode())  # first: by it the folder is known for the daemon's own
        for name, look in looks.items():
            for kind, jpeg in _sheets(look):
                if jpeg is not None:
                    _write_plain(folder / f"{name}-{kind}.jpg", jpeg)
        self._trim(keep=folder)

    def _trim(self, keep: Path) -> None:
        """Drop the oldest folders until the quota holds; the newest always stays, and what the daemon did not make."""
        folders = sorted(
            (f for f in self._folder.iterdir() if _is_plain(f / NUMBERS) and f.is_dir() and not f.is_symlink()),
            key=lambda f: f.lstat().st_mtime,
        )
        sizes = {f: sum(file.lstat().st_size for file in _own_files(f)) for f in folders}
        total = sum(sizes.values())
        for folder in folders:
            if total <= self._quota_bytes or folder == keep:
                break
            total -= sizes[folder]
            if _is_own(folder):
                _remove(folder)


def _own_files(folder: Path) -> list[Path]:
    """Return the files that `keep` writes, without links."""
    return [file for file in folder.iterdir() if OWN.fullmatch(file.name) and _is_plain(file)]


def _kept(folder: Path) -> list[str]:
    """Return the pictures in a job's folder, before first, as they were taken."""
    try:
        found = {file.stem for file in _own_files(folder)} if not folder.is_symlink() else set()
    except OSError:
        return []
    return [f"{look}-{kind}" for look in LOOKS for kind in KINDS if f"{look}-{kind}" in found]


def _read_plain(folder: Path, name: str) -> bytes | None:
    """Read a file of a folder; neither of them may be a link."""
    try:
        at = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError:
        return None
    flags = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    try:
        with os.fdopen(os.open(name, flags, dir_fd=at), "rb") as opened:
            return opened.read() if stat.S_ISREG(os.fstat(opened.fileno()).st_mode) else None
    except OSError:
        return None
    finally:
        os.close(at)


def _is_plain(file: Path) -> bool:
    """Tell whether it is a file, and no link to one."""
    try:
        return stat.S_ISREG(file.lstat().st_mode)
    except OSError:
        return False


def _is_own(folder: Path) -> bool:
    """Tell whether the daemon made a folder: its numbers are those of the job after which it is named."""
    try:
        facts = json.loads(read_small(folder / NUMBERS, MOST_NUMBERS_BYTES))
        return _folder_name(str(facts["id"])) == folder.name
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return False


def _remove(folder: Path) -> None:
    """Remove what the daemon wrote into a folder, and the folder if nothing else is in it."""
    for file in sorted(_own_files(folder), key=lambda file: file.name == NUMBERS):
        file.unlink()
    with suppress(OSError):
        folder.rmdir()


def _write_plain(file: Path, data: bytes) -> None:
    """Write a file; a link in its place is not followed, and a pipe not waited for: OSError."""
    flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    with os.fdopen(os.open(file, flags, 0o644), "wb") as opened:
        opened.write(data)


def _sheets(look: LookResult) -> Iterator[tuple[str, bytes | None]]:
    """Yield what a look leaves, JPEG: the frames as the camera coded them, and what was made of them."""
    yield "white", look.white.jpeg or _coded(look.white.pixels)
    if look.red is not None:
        yield "red", look.red.jpeg or _coded(look.red.pixels)
    for kind, drawn in _drawings(look):
        yield kind, _coded(drawn)


def _coded(pixels: Pixels) -> bytes | None:
    ok, data = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return bytes(data.tobytes()) if ok else None


def _drawings(look: LookResult) -> Iterator[tuple[str, Pixels]]:
    """Yield what was made of a look's frames."""
    if look.tip is not None:
        yield "tip", draw_tip(look.white.pixels, look.tip, near_px=look.expected_tip_px)
    if look.landing is not None:
        yield "landing", draw_landing(look.white.pixels, look.landing)
    if isinstance(look.tip, Tip) and look.cross is not None:
        yield "cross", draw_control_point(look.white.pixels, look.cross, (look.tip.x_px, look.tip.y_px))
    if isinstance(look.tip, Tip) and look.red is not None and look.seen is not None:
        at = look.tip.x_px, look.tip.y_px
        yield "pads", draw_test_points(look.red.pixels, look.seen, at, needle=look.tip)
    if look.red is not None and look.board is not None:
        yield "board", _with_cad(look.red.pixels, look.board)


def _with_cad(red: Pixels, seen: BoardSeen) -> Pixels:
    """Draw CAD over the red frame."""
    search = seen.search
    about_um = search.reference.about_um
    look = BoardLook(search.sides.here, about_um, seen.board_to_px, seen.found, search.target, seen.hidden_px)
    return draw_board(red, look)


def point_pictures_id(job_id: str, point: str) -> str:
    """Return under which id the pictures of one point of a job are kept."""
    return f"{job_id}.{point}"


def _folder_name(job_id: str) -> str:
    """Return a name that is safe for any file system, and still one id's own, whatever the id is.

    ASCII letters, digits, dot, dash and underscore stay, up to 64; an id that is more than that gets a digest behind a
    tilde, which no id that stays as it is can have.
    """
    safe = re.sub(r"[^A-Za-z0-9._-]", "_", job_id)[:LONGEST_NAME].lstrip(".")
    return safe if safe == job_id else f"{safe}~{hashlib.sha256(job_id.encode()).hexdigest()[:16]}"
