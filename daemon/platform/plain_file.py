"""Reading of a small plain file: no pipe, which would be waited for without end, no device, and no huge file."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

SMALL_BYTES = 1_000_000


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
