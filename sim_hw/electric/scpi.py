"""SCPI as the simulated meter reads it: headers, paths, parameters, and the queue of errors. Pure.

Sources: IEEE 488.2, chapters 7 and 8 (messages, units, numbers); SCPI-99 volume 1, 6.2 (short and long words, optional
nodes, the path after a semicolon) and 7.2 (numbers with suffixes); volume 2, 21.8 (errors).
"""

from __future__ import annotations

import re
from collections import deque
from dataclasses import dataclass

UNDEFINED_HEADER = (-113, "Undefined header")
SYNTAX = (-102, "Syntax error")
NOT_ALLOWED = (-108, "Parameter not allowed")
MISSING = (-109, "Missing parameter")
WRONG_TYPE = (-104, "Data type error")
BAD_SUFFIX = (-131, "Invalid suffix")
OUT_OF_RANGE = (-222, "Data out of range")
STALE = (-230, "Data corrupt or stale")
OVERFLOW = (-350, "Queue overflow")
NONE = (0, "No error")
_QUEUE = 20
_MOST_CHANNELS = 1000

_NUMBER = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[Ee][+-]?\d+)?)\s*([A-Za-z]*)")
_CHANNELS = re.compile(r"\(\s*@\s*(\d+(?:\s*[,:]\s*\d+)*)\s*\)")
_MULTIPLIERS = {
    "": 1.0, "K": 1e3, "MA": 1e6, "G": 1e9, "M": 1e-3, "U": 1e-6, "N": 1e-9, "P": 1e-12,
}  # fmt: skip
_UNITS = ("OHM", "V", "F", "A", "S")


class ScpiError(Exception):
    """An entry for the error queue."""

    def __init__(self, entry: tuple[int, str]) -> None:
        super().__init__(entry[1])
        self.entry = entry


@dataclass(frozen=True)
class Unit:
    """One command or query: its header in capitals, from the root, and its parameters."""

    header: str
    query: bool
    parameters: tuple[str, ...]


class ErrorQueue:
    """First in, first out; when it is full its last entry becomes "Queue overflow"."""

    def __init__(self) -> None:
        self._entries: deque[tuple[int, str]] = deque()

    def put(self, entry: tuple[int, str]) -> None:
        """Add an entry."""
        if len(self._entries) == _QUEUE:
            self._entries[-1] = OVERFLOW
        else:
            self._entries.append(entry)

    def take(self) -> str:
        """Return the oldest entry as it is answered, and forget it."""
        code, text = self._entries.popleft() if self._entries else NONE
        return f'{code:+d},"{text}"'

    def clear(self) -> None:
        """Forget all."""
        self._entries.clear()

    def __len__(self) -> int:
        return len(self._entries)


def units(message: str) -> list[Unit]:
    """Return the units of a message with their whole headers.

    A unit that begins without a colon goes on where the one before it was, less its last word; a common command (`*`)
    leaves that place as it is.
    """
    found: list[Unit] = []
    path = ""
    for text in _split(message, ";"):
        head, _, rest = text.strip().partition(" ")
        if not head:
            continue
        query = head.endswith("?")
        words = head.removesuffix("?").upper()
        if not words.startswith("*"):
            words = words[1:] if words.startswith(":") else path + words
            path = words.rpartition(":")[0]
            path = f"{path}:" if path else ""
        found.append(Unit(words, query, tuple(part.strip() for part in _split(rest, ",") if part.strip())))
    return found


def pattern(header: str) -> re.Pattern[str]:
    """Return what matches a header as manuals print it: `[SENSe:]RESistance:NPLCycles`."""
    text = ""
    for word in re.findall(r"\[:?[A-Za-z]+:?\]|[*A-Za-z]+|:", header):
        if word.startswith("["):
            before, after = word.startswith("[:"), word.endswith(":]")
            inner = _word(word.strip("[:]"))
            text += f"(?:{':' if before else ''}{inner}{':' if after else ''})?"
        else:
            text += ":" if word == ":" else _word(word)
    return re.compile(text)


def number(text: str, *, unit: str = "") -> float:
    """Return a number with its suffix; raise ScpiError. `M` is milli but in MOHM, where it is mega (SCPI-99, 7.2)."""
    found = _NUMBER.fullmatch(text)
    if found is None:
        raise ScpiError(WRONG_TYPE)
    suffix = found[2].upper()
    if not suffix:
        return float(found[1])
    if not unit or not suffix.endswith(unit) or unit not in _UNITS:
        raise ScpiError(BAD_SUFFIX)
    prefix = suffix.removesuffix(unit)
    if unit == "OHM" and prefix == "M":
        prefix = "MA"
    if prefix not in _MULTIPLIERS:
        raise ScpiError(BAD_SUFFIX)
    return float(found[1]) * _MULTIPLIERS[prefix]


def channel_list(text: str) -> tuple[int, ...]:
    """Return the channels of `(@101,103:105)`; raise ScpiError."""
    found = _CHANNELS.fullmatch(text)
    if found is None:
        raise ScpiError(SYNTAX)
    channels: list[int] = []
    for part in found[1].split(","):
        first, _, last = part.partition(":")
        low, high = int(first), int(last or first)
        if not low <= high < low + _MOST_CHANNELS:
            raise ScpiError(OUT_OF_RANGE)
        channels += range(low, high + 1)
    return tuple(channels)


def _word(word: str) -> str:
    """Return a pattern for the short word (its capitals) and the long one, and nothing between."""
    if word.startswith("*"):
        return re.escape(word.upper())
    short = "".join(letter for letter in word if letter.isupper())
    rest = word.upper().removeprefix(short)
    return f"{short}(?:{rest})?" if rest else short


def _split(text: str, mark: str) -> list[str]:
    """Split at a mark that is not inside quotes or parentheses."""
    parts, depth, quote = [""], 0, ""
    for letter in text:
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "\"'":
            quote = letter
        elif letter in "()":
            depth += 1 if letter == "(" else -1
        elif letter == mark and depth == 0:
            parts.append("")
            continue
        parts[-1] += letter
    return parts
