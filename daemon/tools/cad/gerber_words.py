"""Commands of a Gerber file and numbers in its coordinate format; nothing is drawn here.

Source: Gerber layer format specification 2024.05, section 3; format and zeros of older issues.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

INCH_MM = 25.4
FARTHEST_MM = 10_000.0
"""No board is as large as this: a coordinate beyond is damaged."""


class CannotDrawError(ValueError):
    """A Gerber file cannot be drawn; the text says why in plain words."""


_COMMAND = re.compile(r"\s*(?:(G0?4(?!\d)[^*]*)\*|%([^%]*)%|([^*%]+)\*)")
_FORMAT = re.compile(r"FS([LTD]?)([AI]?)[NG\d]*X(\d)(\d)Y(\d)(\d)")
_EAGLE_COMMENT = re.compile(r"^(G0?4\s*#@!\s*)%(T[FAOD][^*%\n]*)\*%?\*?", re.MULTILINE)
_X2_COMMENT = re.compile(r"G0?4\s*#@!\s*%?(T[FAOD][^*%]*)")


def commands(text: str) -> Iterator[tuple[bool, str]]:
    """Yield (extended, command without its `*`); X2 attributes in comments count as extended, comments are dropped.

    An aperture macro stays whole; other extended commands in one pair of `%` come one by one.
    """
    text = _EAGLE_COMMENT.sub(r"\1\2*", text)  # EAGLE puts whole commands into comments, `%` and all
    for note, extended, word in _COMMAND.findall(text):
        if note:
            if found := _X2_COMMENT.match(note):
                yield True, found[1].strip()
        elif extended:
            body = extended.strip().replace("\n", "").replace("\r", "")
            if body.startswith("AM"):
                yield True, body
            else:
                yield from ((True, part.strip()) for part in body.split("*") if part.strip())
        elif stripped := word.strip():
            yield False, stripped


def is_torn(text: str) -> bool:
    """Say whether the text stops in the middle of a command; DOS ends a text with control-Z."""
    return bool(text[max(text.rfind("*"), text.rfind("%")) + 1 :].strip(" \t\r\n\0\x1a"))


@dataclass(slots=True)
class Numbers:
    """How coordinates are written. unit_mm: 0 until the file says it."""

    unit_mm: float = 0.0
    integers: int = 2
    decimals: int = 4
    trailing_cut: bool = False
    incremental: bool = False
    known: bool = False

    def take_format(self, command: str) -> None:
        """Read `%FS...*%`; raise ValueError if it is none."""
        found = _FORMAT.match(command)
        if not found:
            raise CannotDrawError(f"the coordinate format {command!r} cannot be read")
        self.trailing_cut, self.incremental = found[1] == "T", found[2] == "I"
        self.integers, self.decimals, self.known = int(found[3]), int(found[4]), True

    def length_mm(self, digits: str) -> float:
        """Return a coordinate in mm; raise ValueError for one that lies on no board."""
        unit_mm = self.unit_mm or INCH_MM
        if not self.trailing_cut and "." not in digits:  # nearly all
            found = int(digits) * (10.0**-self.decimals * unit_mm)
        elif "." in digits:
            found = float(digits) * unit_mm
        else:
            sign, digits = ("-", digits[1:]) if digits[:1] == "-" else ("", digits.lstrip("+"))
            digits = digits.ljust(self.integers + self.decimals, "0")
            found = int(sign + digits) * 10.0**-self.decimals * unit_mm
        if not -FARTHEST_MM < found < FARTHEST_MM:
            raise CannotDrawError(f"the coordinate {digits[:12]}... lies on no board")
        return found


def attribute_fields(text: str) -> list[str]:
    """Split an attribute's value and take its escapes back (u002C behind a backslash is a comma)."""
    return [re.sub(r"\\u([0-9A-Fa-f]{4})", lambda m: chr(int(m[1], 16)), f) for f in text.split(",")]


def file_attributes(text: str) -> dict[str, list[str]]:
    """Return the X2 file attributes (`.FileFunction` -> fields), as commands or in comments, wherever they stand."""
    found: dict[str, list[str]] = {}
    for body in re.findall(r"(?:%|#@!\s*%?)\s*TF\s*(\.[^*%\r\n]*)", text[:100_000]):
        name, *fields = attribute_fields(body.strip())
        found.setdefault(name, [f.strip() for f in fields])
    return found
