"""Image and result files: read with a check of what they are, written whole or not at all."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.markup import escape

from daemon.cli.output import FAILED, USAGE, err, fail
from daemon.platform.atomic_file import replace_whole

Pixels = NDArray[np.uint8]
SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp"})
JPEG_QUALITY = 92
AS_8_BIT = "store the camera's frames as 8-bit colour, PNG or JPEG"


@dataclass(frozen=True)
class BadPicture(Exception):
    """Say why a file is no usable picture, and what to do."""

    problem: str
    advice: str


def open_picture(path: Path) -> Pixels:
    """Return a stored picture (H, W, 3) BGR, with a word on stderr if it had to be converted; end if it is unusable."""
    try:
        pixels, note = decode(path.read_bytes())
    except OSError as exc:
        fail(f"cannot read {path}: {exc.strerror}", code=USAGE)
    except BadPicture as exc:
        fail(f"{path}: {exc.problem}", advice=exc.advice, code=USAGE)
    if note:
        err.print(escape(f"{path}: {note}"), style="yellow", highlight=False, soft_wrap=True)
    return pixels


def decode(data: bytes) -> tuple[Pixels, str]:
    """Return the pixels (H, W, 3) uint8 BGR of a picture file, and what was converted, if anything.

    Raises `BadPicture` for anything else than a whole 8-bit picture in gray or colour.
    """
    if _torn(data):
        raise BadPicture("the picture ends early: it was not written or copied whole", "copy or take it again")
    try:
        image: Any = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        image = None
    if image is None:
        raise BadPicture("this is not a picture", "give a PNG, JPEG, BMP, TIFF or WebP file")
    if image.dtype != np.uint8:
        problem = f"its pixels have {8 * image.dtype.itemsize} bits: what is white in them is not known"
        raise BadPicture(problem, AS_8_BIT)
    if image.ndim == 2:
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), dtype=np.uint8), "a gray picture, taken as it is"
    if image.shape[2] == 4:
        if not np.all(image[:, :, 3] == 255):
            raise BadPicture("parts of it are transparent: it is no camera's frame", AS_8_BIT)
        return np.ascontiguousarray(image[:, :, :3]), "its alpha channel hides nothing and is left out"
    if image.shape[2] != 3:
        raise BadPicture(f"it has {image.shape[2]} channels", AS_8_BIT)
    return np.asarray(image, dtype=np.uint8), ""


def _torn(data: bytes) -> bool:
    """Tell whether the end mark of a PNG or JPEG is missing; decoders fill the rest with gray and go on."""
    if data.startswith(b"\x89PNG"):
        return b"IEND" not in data
    return data.startswith(b"\xff\xd8") and b"\xff\xd9" not in data[-4096:]


def check_target(path: Path, sources: list[Path]) -> None:
    """End with a message unless a picture can be written to `path` without destroying one of the `sources`."""
    if path.suffix.lower() not in SUFFIXES:
        fail(f"{path}: no picture's name", advice=f"end it in one of {', '.join(sorted(SUFFIXES))}", code=USAGE)
    check_place(path, sources)


def check_place(path: Path, sources: list[Path]) -> None:
    """End with a message unless a file can be put at `path` without destroying one of the `sources`."""
    try:
        is_folder, has_folder = path.is_dir(), path.parent.is_dir()
    except OSError as exc:
        _cannot_write(path, exc, USAGE)
    if not has_folder:
        fail(f"there is no folder {path.parent}", advice="make it first", code=USAGE)
    if is_folder:
        fail(f"{path} is a folder", advice="give the name of a file in it", code=USAGE)
    if path.resolve() in {source.resolve() for source in sources}:
        fail(f"{path} is read, it cannot be written too", advice="give another name", code=USAGE)


def write_picture(path: Path, pixels: Pixels) -> None:
    """Write a picture in the format its name asks for; end with a message if that fails."""
    suffix = path.suffix.lower()
    quality = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY] if suffix in (".jpg", ".jpeg") else []
    ok, data = cv2.imencode(suffix, pixels, quality)
    if not ok:
        fail(f"cannot write {path} as {suffix}", advice="end its name in .png")
    keep(path, lambda beside: beside.write_bytes(data.tobytes()))


def keep(path: Path, write: Callable[[Path], object]) -> None:
    """Let `write` make the file `path`, whole or not at all."""
    try:
        replace_whole(path, write)
    except OSError as exc:
        _cannot_write(path, exc)


def _cannot_write(path: Path, exc: OSError, code: int = FAILED) -> NoReturn:
    fail(f"cannot write {path}: {exc.strerror}", code=code)
