"""Messages without file paths: who reads the wire cannot act on one, and need not know where things lie."""

from __future__ import annotations

import re

_PATH = re.compile(r"(?<![\w./:])/(?:[^\s/:;,'\"()]+/)+([^\s/:;,'\"()]+)/?")


def without_paths(text: str) -> str:
    """Return a text with the last name in the place of each absolute path: `/dev/serial/by-id/x` is `x`."""
    return _PATH.sub(r"\1", text)
