"""Line numbers of the keys of a TOML text, and hints at what a line that is no TOML was meant to be.

`tomllib` keeps no places. This reads tables and keys once more, and lines only: a text that `tomllib` takes is given.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping

_KEY = r"(?:[A-Za-z0-9_-]+|\"[^\"]*\"|'[^']*')"
_DOTTED = rf"{_KEY}(?:\s*\.\s*{_KEY})*"
_TABLE = re.compile(rf"\s*\[\[?\s*({_DOTTED})\s*\]")
_ASSIGNED = re.compile(rf"\s*({_DOTTED})\s*=\s*(.*)")
_INLINE = re.compile(rf"[{{,]\s*({_DOTTED})\s*=")
_PARTS = re.compile(_KEY)
_AT = re.compile(r"\(at line (\d+), column \d+\)")
_MEANT: tuple[tuple[str, str], ...] = (
    ("=\\s*[\u2010-\u2015\u2212]", "write a plain minus: -"),
    (
        r"=\s*[-+]?\d+(?:[.]\d{3})+(?:,\d*)?\s*(?:#|$)|=\s*[-+]?\d{1,3}(?:,\d{3})+(?:[.]\d*)?\s*(?:#|$)",
        "write a large number in one piece, with a decimal point: 200000.0",
    ),
    (r"=\s*[-+]?\d+,\d", "write a decimal point, not a comma"),
    ("[\u2018-\u201e\u00ab\u00bb]", 'write plain quotes: "text"'),
    (
        r"=\s*[-+]?[\d_.]+\s*(?:(?:um|mm|ms|s|deg|mb|ohm|\u00b5m|\u03bcm)\b|%|\u00b0|\u03a9|\u2126)",
        "write the number alone; the unit is the key's own",
    ),
    ("[\u00a0\u2000-\u200f\u202f\ufeff]", "a blank in it is none of the keyboard's; type the line anew"),
    (r"^\s*[\w.-]*[^\x00-\x7f][^=\"'#]*=", "a key has the letters a-z, digits and _ alone"),
    (r"=\s*[-+]\s+\d", "write the sign close to its number: -200.0"),
    (r"=\s*=", "write one = alone"),
    (r"=\s*[-+]?(?:\d+[.](?![\d])|[.]\d)", "write a digit on both sides of the decimal point: 0.5, 200000.0"),
    (r"=\s*[-+]?[\d_.]+\s*[*/+^-]\s*[\d(]", "write the result: nothing is calculated here"),
    (r"^\s*[{(].*[})]\s*(?:#|$)", "the name of a table stands between square brackets: [axes.x]"),
    (rf"^\s*\[{_DOTTED}[^\].]*\s[^\]]*\]", "the name of a table has no blanks: write [bus.main], or quotes round it"),
    (r"=\s*(?:\"[^\"]*\"|'[^']*'|[\w.+-]+)\s*,\s*(?:#|$)", "a line ends without a comma"),
    (r"=\s*\[[^\]#]*(?:\"[^\",\]]*\"|[\d.])\s+[\"\d]", "put a comma between the elements of the list"),
    (r"=\s*[-+]?\d+[ ']\d", "write a large number in one piece: 200000 or 200_000"),
    (r"=\s*[-+]?0\d", "a number begins with no 0"),
    (r"=\s*(?:[Tt][Rr][Uu][Ee]|[Ff][Aa][Ll][Ss][Ee]|yes|no|on|off)\b", "write true or false, in small letters"),
    (r"=\s*(?:[Nn]one|null|nil|~)\s*(?:#|$)", "there is no such value in TOML: leave the line out"),
    (r"=\s*\"[^\"]*\\", "write a path with / or between single quotes: 'C:\\folder'"),
    (r"=\s*(?:#|$)", "a value is missing behind the ="),
    (r"=\s*[\"'][^\"']*$", "the closing quote is missing"),
    (r"=\s*[A-Za-z/]", 'write a text between quotes: "text"'),
    (rf"^\s*\[{_DOTTED}\s*(?:#|$)", "the closing ] of the table is missing"),
    (rf"^\s*{_DOTTED}\s*:", "write key = value, with = and not :"),
    (r"^\s*(?://|;|--)|=\s*(?:\"[^\"]*\"|'[^']*'|[\w.+-]+)\s*(?://|;|--)", "a remark begins with #"),
    (rf"^\s*{_DOTTED}\s+[^=\s]+", "write key = value: the = is missing"),
)


def line_numbers(text: str) -> dict[str, int]:
    """Return dotted path -> line, from 1, of every table and key; of one that stands twice the first."""
    found: dict[str, int] = {}
    table = ""
    for number, line in _statements(text):
        if header := _TABLE.match(line):
            table = _path(header[1])
            _note(found, table, number)
        elif given := _ASSIGNED.match(line):
            path = _joined(table, _path(given[1]))
            _note(found, path, number)
            for inner in _INLINE.finditer(given[2]):
                _note(found, _joined(path, _path(inner[1])), number)
    return found


def line_of(lines: Mapping[str, int], path: str) -> int | None:
    """Return the line of a path, or of the nearest table around it; None where the file has neither."""
    while path not in lines:
        if "." not in path:
            return None
        path = path.rpartition(".")[0]
    return lines[path]


def what_was_meant(text: str, error: tomllib.TOMLDecodeError) -> str:
    """Say what is wrong with a text that is no TOML, in which line, and how it is written instead."""
    said = str(error)
    if not (at := _AT.search(said)):
        return f"{said}; see the end of the file: a quote or a bracket may be left open"
    number, lines = int(at[1]), text.split("\n")
    # An open quote, bracket or end of line is noticed where the next line begins.
    for back in (number, number - 1):
        line = lines[back - 1] if 0 < back <= len(lines) else ""
        for pattern, cure in _MEANT:
            if re.search(pattern, line):
                return f"line {back}: {line.strip()[:80]!r}: {cure} ({said})"
    if "Unclosed array" in said:
        return f"line {number}: a comma, or the closing ] of the list that begins here or above, is missing ({said})"
    if "overwrite" in said or "twice" in said or "Cannot declare" in said:
        return f"line {number}: the key or table stands in the file twice; keep one ({said})"
    return f"line {number}: {said}"


def _statements(text: str) -> Iterator[tuple[int, str]]:
    """Yield the lines that may begin a statement: none within a text of several lines or a list."""
    fence, depth = "", 0
    # As TOML counts: the other ends of lines that `splitlines` knows may stand within a remark or a name.
    for number, line in enumerate(text.split("\n"), start=1):
        if fence:
            fence = "" if fence in line else fence
            continue
        bare = re.sub(r"\"(?:\\.|[^\"\\])*\"|'[^']*'|#.*", "", line)
        if depth <= 0:
            yield number, line
            if opened := re.search(r"=\s*(\"\"\"|''')", line):
                fence = "" if line.count(opened[1]) > 1 else opened[1]
                continue
            depth = 0 if _TABLE.match(line) else bare.count("[") - bare.count("]")
        else:
            depth += bare.count("[") - bare.count("]")


def _path(dotted: str) -> str:
    return ".".join(part.strip("\"'") for part in _PARTS.findall(dotted))


def _joined(table: str, key: str) -> str:
    return f"{table}.{key}" if table else key


def _note(found: dict[str, int], path: str, number: int) -> None:
    """Note a place, and that its tables begin there at the latest."""
    parts = path.split(".")
    for end in range(1, len(parts) + 1):
        found.setdefault(".".join(parts[:end]), number)


def array_lines(text: str, table: str) -> list[dict[str, int]]:
    """Return the lines of each element of an array of tables `[[table]]`: key -> line, "" -> line of its head."""
    found: list[dict[str, int]] = []
    within = False
    for number, line in _statements(text):
        if header := _TABLE.match(line):
            within = _path(header[1]) == table
            if within:
                found.append({"": number})
        elif within and (given := _ASSIGNED.match(line)):
            found[-1].setdefault(_path(given[1]), number)
    return found
