"""Editing of a configuration's text: values are put in their lines, and everything else, remarks too, stays."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping
from typing import Any

from daemon.config.toml_lines import line_numbers
from daemon.tools.install import shipped

Value = str | float | int | bool | None
"""None: the key is taken out."""
_LINE = re.compile(r"^(\s*[\w.-]+\s*=\s*)(\"(?:[^\"\\]|\\.)*\"|'[^']*'|[\w.+-]+|\[[^\]#]*\])(\s*(?:#.*)?)$")
EXAMPLE = "station.example.toml"


def example() -> str:
    """Return the example that a new configuration begins as; `InstallError` if it is not there."""
    return (shipped() / EXAMPLE).read_text(encoding="utf-8")


def read_value(text: str, path: str) -> Any:
    """Return the value at a dotted path, None where there is none."""
    found: Any = tomllib.loads(text)
    for part in path.split("."):
        if not isinstance(found, dict) or part not in found:
            return None
        found = found[part]
    return found


def with_values(text: str, values: Mapping[str, Value]) -> str:
    """Return the text with these values at their dotted paths; ValueError if a table is missing."""
    for path, value in values.items():
        text = _with_value(text, path, value)
    for path, value in values.items():
        if read_value(text, path) != value:
            raise ValueError(f"{path} could not be written into the file")
    return text


def _with_value(text: str, path: str, value: Value) -> str:
    lines = text.removesuffix("\n").split("\n")  # as TOML ends a line, no other way
    numbers = line_numbers(text)
    table, _, key = path.rpartition(".")
    written = _written(value)
    if value is None:
        if path in numbers:
            del lines[numbers[path] - 1]
    elif path in numbers:
        at = numbers[path] - 1
        found = _LINE.match(lines[at])
        if found is None:
            raise ValueError(f"line {numbers[path]} is written in a way that is not changed here; edit {path} by hand")
        lines[at] = f"{found[1]}{written}{found[3]}"
    elif table in numbers:
        lines.insert(numbers[table], f"{key} = {written}")
    else:
        lines += ["", f"[{table}]", f"{key} = {written}"]
    return "\n".join(lines) + "\n"


def _written(value: Value) -> str:
    """Return a value as TOML has it: its letters as they are, and what shows nothing by its number."""
    if not isinstance(value, str):
        return json.dumps(value)
    return "".join(c if c.isprintable() else _by_number(c) for c in json.dumps(value, ensure_ascii=False))


def _by_number(letter: str) -> str:
    return f"\\u{ord(letter):04x}" if ord(letter) < 0x10000 else f"\\U{ord(letter):08x}"
