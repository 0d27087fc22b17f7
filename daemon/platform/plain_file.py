"""Reading of a small plain file: no pipe, which would be waited for without end, no device, and no huge file.

And its text, which is UTF-8: what some editors make of it else is said by name.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

SMALL_BYTES = 1_000_000
_OTHERS = ("UTF-32-LE", "UTF-32-BE", "UTF-16-LE", "UTF-16-BE")
"""What begins as UTF-32 begins as UTF-16, too: the longer ones first."""
_MARK = "\ufeff"


def read_small(path: Path, most_bytes: int = SMALL_BYTES) -> bytes:
    """Return the content of a plain file; raise OSError, which says also why it is none or that it is too large."""
    # Without O_NONBLOCK, opening a pipe waits for somebody who writes into it.
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    with os.fdopen(descriptor, "rb") as file:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise OSError(errno.EINVAL, "it is no plain file", str(path))
        content = file.read(most_bytes + 1)
    if len(content) > most_bytes:
        raise OSError(errno.EFBIG, f"it is larger than {most_bytes} bytes", str(path))
    return content


def as_text(content: bytes) -> str:
    """Return the text of a file, without the mark that some editors begin it with.

    ValueError for what is no UTF-8; it says how the file was saved instead, or the line of the first byte that is none.
    """
    if (other := _other_encoding(content)) is not None:
        raise ValueError(f"it is saved as {other}: save it as UTF-8")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as exc:
        line = content.count(b"\n", 0, exc.start) + 1
        raise ValueError(f"line {line} is not UTF-8 (byte {content[exc.start]:02x}h); save the file as UTF-8") from exc
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise ValueError(f"line {line} has bytes of zero: the file is damaged; write it again, or take a copy back")
    return text


def _other_encoding(content: bytes) -> str | None:
    """Return the name of the encoding by its mark, or by the zeros that it has beside each plain letter."""
    for name in _OTHERS:
        if content.startswith(_MARK.encode(name)):
            return name[:6]
    even, odd = content[::2].count(0), content[1::2].count(0)
    each = len(content) // 2
    return "UTF-16" if each > 1 and max(even, odd) > 0.8 * each and min(even, odd) == 0 else None
