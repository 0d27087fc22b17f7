"""Reading of a configuration file: TOML, fields, cross-checks and plausible ranges, every problem in one go."""

from __future__ import annotations

import copy
import tomllib
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from daemon.config.cross_checks import cross_checks
from daemon.config.plausible import heights_meant, implausible, unlikely
from daemon.config.problems import ConfigError, Problem, Unlikely, in_words
from daemon.config.raw_values import RawValues
from daemon.config.toml_lines import line_numbers, what_was_meant
from daemon.platform.plain_file import as_text, read_small

MOST_BYTES, LONGEST_LINE = 250_000, 1_000
"""A key of many dots costs the parser the square of their number: one of 50,000 takes minutes."""
Root = TypeVar("Root", bound=BaseModel)


def read_checked(path: Path, root: type[Root]) -> Root:
    """Return the file's tree; raise `ConfigError` naming every problem."""
    text, raw = _parse(path)
    lines = line_numbers(text)
    if not raw:
        said = "nothing is written in it; `reprobe setup` writes one, or begin with a copy of station.example.toml"
        raise ConfigError(path, [("(file)", said)])
    values = RawValues(raw, root)
    tree, fields = _validate(raw, root)
    # A height in mm is one mistake: what follows from it for the others is judged by the height that was meant.
    meant = values.with_numbers(heights_meant(values))
    problems = _once([*values.wrong_kinds(), *fields, *cross_checks(meant), *implausible(values)])
    if problems or tree is None:
        order = sorted(problems, key=lambda problem: _order(lines, problem[0]))
        raise ConfigError(path, order, lines)
    return tree


def read_unlikely(path: Path, root: type[BaseModel]) -> Unlikely:
    """Return what a file has that is possible and hardly meant; raise `ConfigError` if it is no TOML."""
    text, raw = _parse(path)
    return Unlikely(list(unlikely(RawValues(raw, root), path.resolve().parent)), line_numbers(text))


def toml_text(path: Path) -> str:
    """Return the text of a file that is TOML; raise `ConfigError` with the line and the cause if it is none."""
    return _parse(path)[0]


def _parse(path: Path) -> tuple[str, dict[str, Any]]:
    """Return the file's text, and the tree of its values."""
    text = _text(path)
    if any(len(line) > LONGEST_LINE for line in text.split("\n")):
        raise ConfigError(path, [("(file)", f"it has a line of more than {LONGEST_LINE} letters")])
    try:
        return text, tomllib.loads(text)
    except tomllib.TOMLDecodeError as exc:
        raise ConfigError(path, [("(file)", f"is not TOML: {what_was_meant(text, exc)}")]) from exc
    except RecursionError:
        # Its thousand frames say nothing; they are let go of here.
        raise ConfigError(path, [("(file)", "its tables and lists are nested too deeply")]) from None


def _text(path: Path) -> str:
    try:
        content = read_small(path, MOST_BYTES)
    except (OSError, ValueError) as exc:
        why = (exc.strerror if isinstance(exc, OSError) else None) or str(exc)
        raise ConfigError(path, [("(file)", f"cannot be read: {why}; give the path of a station.toml")]) from exc
    try:
        return as_text(content)
    except ValueError as exc:
        raise ConfigError(path, [("(file)", f"is not TOML: {exc}")]) from exc


def _validate(raw: dict[str, Any], root: type[Root]) -> tuple[Root | None, list[Problem]]:
    """Validate; where fields are wrong, once more without them, for the sections' own checks."""
    try:
        return root.model_validate(raw), []
    except ValidationError as exc:
        errors = exc.errors()
    problems = list(in_words(errors, root))
    rest = copy.deepcopy(raw)
    for error in errors:
        if error["type"] not in {"missing", "value_error"}:
            _take_out(rest, error["loc"])
    try:
        root.model_validate(rest)
    except ValidationError as exc:
        problems += in_words((error for error in exc.errors() if error["type"] == "value_error"), root)
    return None, problems


def _take_out(raw: Any, place: tuple[int | str, ...]) -> None:
    for part in place[:-1]:
        raw = raw.get(part) if isinstance(raw, dict) else None
    if isinstance(raw, dict):
        raw.pop(place[-1], None)


def _once(problems: list[Problem]) -> list[Problem]:
    """Leave out what is said twice, and what pydantic says of a value that is of another kind altogether."""
    kept: dict[Problem, None] = {}
    for where, what in problems:
        kind = next((one for one in kept if one[0] == where and "write the number" in one[1]), None)
        if kind is None:
            kept[where, what] = None
    return list(kept)


def _order(lines: dict[str, int], where: str) -> int:
    while where not in lines:
        if "." not in where:
            return 0
        where = where.rpartition(".")[0]
    return lines[where]
