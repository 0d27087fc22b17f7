"""Safe cells for spreadsheets: a name from outside that begins like a formula is marked as text (CSV injection)."""

from __future__ import annotations

import unicodedata
from typing import Any

FORMULA = ("=", "+", "-", "@")
UNSEEN = "".join(map(chr, range(33))) + "\x7f\xa0\ufeff\u200b"
"""Letters before a formula that some spreadsheets pass over."""


def plain_cell(value: Any) -> Any:
    """Return a text that begins like a formula with a quote before it, also behind letters that are not seen."""
    if not isinstance(value, str):
        return value
    begins = unicodedata.normalize("NFKC", value).lstrip(UNSEEN)[:1]
    return f"'{value}" if begins in FORMULA or value[:1] in ("\t", "\r", "\n") else value
