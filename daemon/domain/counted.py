"""Numbers of things, as people say them."""

from __future__ import annotations


def counted(number: int, one: str, more: str = "") -> str:
    """Return such as `1 net` or `0 nets`; `more`: the plural where it is not `one` with an s."""
    return f"{number} {one if number == 1 else more or one + 's'}"
