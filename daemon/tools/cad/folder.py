"""Files of a CAD folder or zip, read whole and with bounds: nothing is unpacked to the disk.

A zip is never trusted: names stay inside of it, sizes are counted while reading, so that neither a bomb nor a path
that climbs out does harm.
"""

from __future__ import annotations

import hashlib
import io
import os
import zipfile
import zlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path, PurePosixPath

from daemon.tools.cad.foreign import INSTEAD, PACKED, foreign_format, is_packed

_HEAD = 20_000
MAX_FILES, MAX_FILE_BYTES, MAX_ALL_BYTES, MAX_DEPTH = 2000, 80_000_000, 400_000_000, 5
_ZIPS_IN_ZIPS = 2
_SKIPPED = {"__macosx", ".git", ".svn", ".ds_store", "thumbs.db", "desktop.ini"}
_BINARY = {
    ".pdf", ".png", ".jpg", ".jpeg", ".bmp", ".gif", ".svg", ".step", ".stp", ".stl", ".wrl", ".dxf", ".xlsx", ".xls",
    ".docx", ".doc", ".md", ".html", ".htm", ".7z", ".rar", ".dwg", ".igs", ".3dshapes", ".kicad_sch", ".schdoc", ".py",
}  # fmt: skip


@dataclass(frozen=True)
class CadFile:
    """A file of the folder: its name there with `/`, and its bytes."""

    name: str
    data: bytes

    @cached_property
    def text(self) -> str:
        """The content as text: line ends of any kind are one, UTF-16 is read, what is not UTF-8 as Latin-1.

        No two bytes become one sign: two nets must not become one.
        """
        if self.data[:2] in (b"\xff\xfe", b"\xfe\xff"):
            text = self.data.decode("utf-16", errors="replace")
        else:
            try:
                text = self.data.decode("utf-8-sig")
            except UnicodeDecodeError:
                text = self.data.decode("latin-1")
        return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text

    @cached_property
    def is_text(self) -> bool:
        """Whether it may hold CAD in text; pictures and archives do not."""
        return b"\0" not in self.data[:4096] or self.data[:2] in (b"\xff\xfe", b"\xfe\xff")

    @property
    def sha256(self) -> str:
        """Its fingerprint."""
        return hashlib.sha256(self.data).hexdigest()

    @property
    def suffix(self) -> str:
        """The last suffix, small letters."""
        return PurePosixPath(self.name).suffix.lower()


@dataclass(frozen=True)
class CadFolder:
    """What was found. writable: the roles file can be kept there. left_out: files not even opened, by name.

    outside: files that were named by a person and lie elsewhere.
    """

    path: Path
    name: str
    files: tuple[CadFile, ...]
    writable: bool
    left_out: tuple[str, ...]
    outside: tuple[str, ...] = ()

    def find(self, wanted: Path | str) -> CadFile | None:
        """Return the file meant by a path as a person gives it: inside the folder, or from where they stand."""
        text = str(wanted).replace("\\", "/")
        for file in self.files:
            if file.name == text or file.name.lower() == text.lower():
                return file
        try:
            inside = Path(wanted).resolve().relative_to(self.path.resolve()).as_posix()
        except (ValueError, OSError):
            inside = ""
        same = [f for f in self.files if f.name == inside or PurePosixPath(f.name).name.lower() == text.lower()]
        same = same or [f for f in self.files if f.name in self.outside and f.name.endswith(PurePosixPath(text).name)]
        return same[0] if len(same) == 1 else None


def open_cad(path: Path) -> CadFolder:
    """Read a folder or a zip; raise ValueError with the cure."""
    if path.is_dir():
        return _open_folder(path)
    if path.is_file() and zipfile.is_zipfile(path):
        files, left_out = _read_zip(path, str(path))
        budget = MAX_ALL_BYTES - sum(len(f.data) for f in files)
        files, left_out = _with_zips(files, left_out, budget)
        return CadFolder(path, path.stem, tuple(files), writable=False, left_out=tuple(left_out))
    if path.is_file():
        with path.open("rb") as stream:
            kind = foreign_format(path.name, stream.read(4000))
        if kind is not None:
            raise ValueError(f"{path} is {kind}, which is not read; {INSTEAD}, and give their folder")
        if is_packed(path.name):
            raise ValueError(f"{path} is {PACKED}")
    if path.exists():
        raise ValueError(f"{path} is neither a folder nor a zip; give what holds the Gerber, drill and netlist files")
    raise ValueError(f"{path} does not exist; give the folder or zip that holds the Gerber, drill and netlist files")


def _open_folder(path: Path) -> CadFolder:
    files: list[CadFile] = []
    left_out: list[str] = []
    budget = MAX_ALL_BYTES
    for file in _walk(path):
        name = file.relative_to(path).as_posix()
        size = file.stat().st_size
        if file.suffix.lower() in _BINARY or size > min(MAX_FILE_BYTES, budget):
            left_out.append(name)
            continue
        try:
            files.append(CadFile(name, file.read_bytes()))
        except OSError:
            left_out.append(name)
            continue
        budget -= size
    files, left_out = _with_zips(files, left_out, budget)
    return CadFolder(path, path.resolve().name, tuple(files), os.access(path, os.W_OK), tuple(left_out))


def _with_zips(
    files: list[CadFile], left_out: list[str], budget: int, deep: int = _ZIPS_IN_ZIPS
) -> tuple[list[CadFile], list[str]]:
    """Add what the zips among files hold, unless there are Gerbers beside them: then they are copies for a maker."""
    packed = [f for f in files if f.data[:4] == b"PK\x03\x04"]  # so are some drawings and tables
    zips = packed if len(packed) == 1 else [f for f in packed if f.suffix == ".zip"]
    own = [f for f in files if f not in zips]
    if not zips or any(b"%FS" in f.data[:_HEAD] for f in own):
        return files, left_out
    files, left_out = own, list(left_out)
    for archive in zips:
        inner, more = _read_zip(io.BytesIO(archive.data), archive.name, budget)
        budget -= sum(len(f.data) for f in inner)
        if deep > 1:
            inner, more = _with_zips(inner, more, budget, deep - 1)
        taken = {f.name: f.data for f in files}
        files += [
            CadFile(f"{archive.name}/{f.name}", f.data) if f.name in taken else f
            for f in inner if taken.get(f.name) != f.data
        ]  # fmt: skip
        left_out += more
    return files, left_out


def with_named(folder: CadFolder, paths: Iterable[Path]) -> CadFolder:
    """Add the files that a person names and that lie elsewhere, such as a netlist beside a zip."""
    files, outside = list(folder.files), list(folder.outside)
    for path in paths:
        if folder.find(path) is None and path.is_file() and path.stat().st_size <= MAX_FILE_BYTES:
            name = path.name if all(f.name != path.name for f in files) else path.as_posix()
            files.append(CadFile(name, path.read_bytes()))
            outside.append(name)
    return replace(folder, files=tuple(files), outside=tuple(outside))


def _walk(path: Path) -> list[Path]:
    """Return the plain files below, nearest first; links that lead elsewhere are not followed."""
    found: list[Path] = []
    for root, folders, names in os.walk(path, followlinks=False):
        depth = len(Path(root).relative_to(path).parts)
        folders[:] = sorted(f for f in folders if f.lower() not in _SKIPPED and depth < MAX_DEPTH)
        found += [
            p for n in sorted(names)
            if n.lower() not in _SKIPPED and not n.startswith("._") and (p := Path(root, n)).is_file()
        ]  # fmt: skip
        if len(found) > MAX_FILES:
            raise ValueError(f"{path} holds more than {MAX_FILES} files; give the folder of one board's CAD alone")
    return found


def _read_zip(source: Path | io.BytesIO, called: str, budget: int = MAX_ALL_BYTES) -> tuple[list[CadFile], list[str]]:
    files: list[CadFile] = []
    left_out: list[str] = []
    try:
        with zipfile.ZipFile(source) as archive:
            entries = [e for e in archive.infolist() if not e.is_dir()]
            if len(entries) > MAX_FILES:
                raise ValueError(f"{called} holds more than {MAX_FILES} files; give one board's CAD alone")
            if entries and all(e.flag_bits & 1 for e in entries):
                raise ValueError(f"{called} is locked with a password; unpack it and give the folder")
            for entry in entries:
                if _is_clutter(PurePosixPath(entry.filename)):
                    continue
                name = _safe_name(entry.filename)
                if name is None or entry.flag_bits & 1 or PurePosixPath(name).suffix.lower() in _BINARY:
                    left_out.append(entry.filename)
                    continue
                with archive.open(entry) as stream:
                    data = stream.read(MAX_FILE_BYTES + 1)  # counted here: what the zip says of sizes may be a lie
                budget -= len(data)
                if len(data) > MAX_FILE_BYTES or budget < 0:
                    raise ValueError(f"{called}: {name} unpacks to more than CAD can be; it is not opened")
                files.append(CadFile(name, data))
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, OSError, RuntimeError) as exc:
        raise ValueError(f"{called} is a damaged zip; unpack it and give the folder") from exc
    return _without_shared_root(files), left_out


def _safe_name(name: str) -> str | None:
    """Return the name inside the archive; None for what is no file of the board or climbs out."""
    parts = PurePosixPath(name.replace("\\", "/")).parts
    if not parts or ".." in parts or parts[0] == "/" or ":" in parts[0]:
        return None
    return "/".join(parts)


def _is_clutter(path: PurePosixPath) -> bool:
    """Say whether a packer of its own put a file there; in a folder such files are not seen either."""
    return any(p.lower() in _SKIPPED or p.startswith("._") for p in path.parts)


def _without_shared_root(files: list[CadFile]) -> list[CadFile]:
    """Drop the one folder that holds everything, as most packers make it."""
    roots = {f.name.split("/")[0] for f in files}
    if len(roots) == 1 and all("/" in f.name for f in files):
        return [CadFile(f.name.split("/", 1)[1], f.data) for f in files]
    return files
