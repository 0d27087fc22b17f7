"""Problems of a configuration in words: what stands there, what belongs there, the nearest key, the line."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, TypeAdapter, ValidationError

from daemon.config.raw_values import field_at, model_at, model_of
from daemon.config.toml_lines import line_of

Problem = tuple[str, str]
"""Dotted path, and what is wrong there with its cure."""
__all__ = ["ConfigError", "Problem", "Unlikely", "in_words", "line_of", "nearest", "told"]
_NEAR = 0.6
_SHOWN = 60
OPTIONS_OF_A_COMMAND = frozenset({"uplink", "page", "collect", "demo", "sim"})
"""What people look for in the file, and is told to a process of its own."""
_UNITS = ("_um", "_mm", "_ms", "_s", "_us", "_n", "_mb")
"""Endings of keys whose number is a thousand times off where it was given in another unit."""


class ConfigError(Exception):
    """Say all that is wrong with a configuration, each with its path and, where the file has it, its line."""

    def __init__(self, path: Path, problems: list[Problem], lines: Mapping[str, int] | None = None) -> None:
        self.path = path
        self.problems = problems
        self.lines = lines or {}
        head = f"{path}: {len(problems)} problem{'s' if len(problems) > 1 else ''}"
        super().__init__("\n".join([head, *(f"  {line}" for line in told(problems, self.lines))]))

    def placed(self) -> list[Problem]:
        """Return the problems with the line in their words, for those who show no lines of their own."""
        numbers = [line_of(self.lines, where) for where, _ in self.problems]
        return [
            (where, f"{what} (line {number})" if number is not None else what)
            for (where, what), number in zip(self.problems, numbers, strict=True)
        ]


@dataclass(frozen=True)
class Unlikely:
    """What is possible but hardly meant; it refuses no file."""

    notes: list[Problem]
    lines: Mapping[str, int]


def told(problems: Iterable[Problem], lines: Mapping[str, int]) -> list[str]:
    """Return each problem in one text: line, path, words."""
    return [f"{_line(line_of(lines, where))}{where}: {what}" for where, what in problems]


def _line(number: int | None) -> str:
    return f"line {number}: " if number is not None else ""


def nearest(given: str, known: Iterable[str]) -> str:
    """Return "; is NAME meant?" for the one known name that is like a given one, else nothing."""
    by_small = {name.lower(): name for name in known}
    close = get_close_matches(given.lower(), by_small, n=1, cutoff=_NEAR)
    return f"; is {by_small[close[0]]!r} meant?" if close else ""


def in_words(errors: Iterable[Mapping[str, Any]], root: type[BaseModel]) -> Iterator[Problem]:
    """Yield path and words of each error that pydantic found."""
    listed = list(errors)
    unknown = [_path(error) for error in listed if error["type"] == "extra_forbidden"]
    for error in listed:
        path = _path(error)
        match error["type"]:
            case "extra_forbidden":
                yield path, _unknown(path, root)
            case "missing":
                yield path, _missing(path, unknown, root)
            case "value_error":
                yield path or "(cross-check)", error["msg"].removeprefix("Value error, ")
            case _:
                yield path, _wrong(path, error, root)


def _path(error: Mapping[str, Any]) -> str:
    return ".".join(str(part) for part in error["loc"] if part != "[key]")


def _unknown(path: str, root: type[BaseModel]) -> str:
    above, _, key = path.rpartition(".")
    model = model_at(root, above)
    known = list(model.model_fields) if model is not None else []
    what = f"there is no table [{key}]" if not above else f"there is no key {key!r} in [{above}]"
    if not above and key in OPTIONS_OF_A_COMMAND:
        return f"{what}: its settings are options of a command; leave it out, and see `reprobe {key} --help`"
    if meant := nearest(key, known):
        return what + meant
    if elsewhere := [table for table in _tables_with(key, root) if table != above]:
        return f"{what}; it belongs into [{elsewhere[0]}]"
    return f"{what}; it may have {', '.join(known)}" if known else what


def _tables_with(key: str, root: type[BaseModel], above: str = "") -> Iterator[str]:
    """Yield the tables that have a key."""
    for name, info in root.model_fields.items():
        model, named = model_of(info.annotation)
        if model is None:
            continue
        table = f"{above}{name}{'.NAME' if named else ''}"
        if key in model.model_fields:
            yield table
        yield from _tables_with(key, model, f"{table}.")


def _missing(path: str, unknown: list[str], root: type[BaseModel]) -> str:
    above, _, key = path.rpartition(".")
    if key.isdecimal():  # an element of a list
        about = _about(above, root)
        return f"the list is too short: its element {int(key) + 1} is missing{about}"
    beside = [other.rpartition(".")[2] for other in unknown if other.rpartition(".")[0] == above]
    meant = get_close_matches(key, beside, n=1, cutoff=_NEAR)
    if meant:
        return f"is required and missing; {meant[0]!r} stands there instead"
    info = field_at(root, path)
    model, named = model_of(info.annotation) if info is not None else (None, False)
    if model is not None:
        if named:
            return f"no table [{path}.NAME] is there; one is required, such as [{path}.main] with port"
        needs = ", ".join(name for name, one in model.model_fields.items() if one.is_required())
        return f"the table [{path}] is required and missing; it has {needs}"
    return "is required and missing" + _about(path, root)


def _wrong(path: str, error: Mapping[str, Any], root: type[BaseModel]) -> str:
    given = error["input"]
    shown = (str(given).lower() if isinstance(given, bool) else f"{given!r}")[:_SHOWN]
    said = error["msg"].replace("Input should be", "it should be")
    if error["type"] in {"tuple_type", "list_type"}:
        said = f"it should be a list, between brackets: [{given!r}]"[:_SHOWN].replace("'", '"')
    if error["type"] in {"model_type", "dict_type", "model_attributes_type"}:
        above = path.rpartition(".")[0]
        name = f"[{path}]" if above != "bus" else "[bus.NAME], such as [bus.main], with the keys under it"
        return f"{shown} stands where a table belongs: write {name}"
    if error["type"] in {"literal_error", "enum"}:
        said += nearest(str(given), [str(one) for one in _choices(error)])
    if error["type"] == "string_type":
        said = "it should be a text, between quotes"
    if error["type"] == "string_too_short":
        said = "it should not be empty"
    return f"{shown}: {said}{_about(path, root)}{_thousandfold(path, given, root)}"


def _thousandfold(path: str, given: object, root: type[BaseModel]) -> str:
    """Return "; is NUMBER meant?" where a number out of its limits is within them in another unit."""
    info = field_at(root, path)
    if info is None or isinstance(given, bool) or not isinstance(given, int | float) or not path.endswith(_UNITS):
        return ""
    kind: Any = Annotated[info.annotation, *info.metadata]
    kept = TypeAdapter[Any](kind)
    for factor in (1e3, 1e-3):
        try:
            kept.validate_python(meant := round(given * factor, 6))
        except (ValidationError, OverflowError):
            continue
        return f"; is {meant:g} meant?"
    return ""


def _choices(error: Mapping[str, Any]) -> list[str]:
    expected = str(error.get("ctx", {}).get("expected", ""))
    return [one.strip().strip("'") for one in expected.replace(" or ", ",").split(",")]


def _about(path: str, root: type[BaseModel]) -> str:
    """Return what a field is, with its unit where the description has one."""
    info = field_at(root, path)
    text = info.description if info is not None else None
    return f" ({path.rpartition('.')[2]}: {text})" if text else ""
