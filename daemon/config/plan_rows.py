"""Rows of a plan file, TOML or CSV, with the line of each; what they mean is decided by `plan_file`."""

from __future__ import annotations

import csv
import io
import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from daemon.config.toml_lines import array_lines, line_numbers, what_was_meant

PlanForm = Literal["toml", "csv"]
_REMARK = re.compile(r"#\s*(\w+)\s*[:=]\s*(.*?)\s*")
TABLES = frozenset({"plan", "defaults", "point"})


@dataclass(frozen=True)
class Mistake:
    """What is wrong with a plan file, and in which line, from 1; None where no line is to blame."""

    line: int | None
    what: str

    def __str__(self) -> str:
        """Return both in words."""
        return self.what if self.line is None else f"line {self.line}: {self.what}"


class PlanError(ValueError):
    """Say all that is wrong with a plan file in one go."""

    def __init__(self, mistakes: list[Mistake]) -> None:
        self.mistakes = sorted(mistakes, key=lambda mistake: mistake.line or 0)
        super().__init__("; ".join(map(str, self.mistakes)))


@dataclass(frozen=True)
class Row:
    """One table or line of a plan file: its values, and where each stands."""

    values: Mapping[str, Any]
    line: int | None
    lines: Mapping[str, int] = field(default_factory=dict)

    def line_of(self, key: str) -> int | None:
        """Return the line of a key, or of the row."""
        return self.lines.get(key, self.line)


@dataclass(frozen=True)
class Rows:
    """All of a plan file: what it says of the plan, what every point has by default, and its points."""

    head: Row
    defaults: Row
    points: tuple[Row, ...]
    mistakes: tuple[Mistake, ...] = ()


def read_rows(text: str, form: PlanForm) -> Rows:
    """Return the rows of a plan file; raise `PlanError` for a text that is no TOML, or no table."""
    return _from_toml(text) if form == "toml" else _from_csv(text)


def _from_toml(text: str) -> Rows:
    try:
        raw = tomllib.loads(text)
    except tomllib.TOMLDecodeError as exc:
        raise PlanError([Mistake(None, what_was_meant(text, exc))]) from exc
    lines = line_numbers(text)
    wrong = [Mistake(lines.get(key), f"there is no table [{key}]; a plan has [plan], [defaults] and [[point]]")
             for key in raw if key not in TABLES]  # fmt: skip
    tables = {}
    for name in ("plan", "defaults"):
        value = raw.get(name, {})
        if not isinstance(value, dict):
            wrong.append(Mistake(lines.get(name), f"{name} is a table: write [{name}], and its keys below"))
            value = {}
        keys = {key: line for key in value if (line := lines.get(f"{name}.{key}")) is not None}
        tables[name] = Row(value, lines.get(name), keys)
    points = raw.get("point", [])
    if not isinstance(points, list) or not all(isinstance(point, dict) for point in points):
        raise PlanError([*wrong, Mistake(lines.get("point"), "write each point as a table of its own: [[point]]")])
    places: list[dict[str, int]] = array_lines(text, "point")
    places += [{} for _ in range(len(points) - len(places))]  # written in one line, point = [{...}]
    rows = tuple(
        Row(point, place.get("", lines.get("point")), place) for point, place in zip(points, places, strict=False)
    )
    return Rows(tables["plan"], tables["defaults"], rows, tuple(wrong))


def _from_csv(text: str) -> Rows:
    """Return the rows of a CSV text: remarks `# board: NAME` say what [plan] says, the first other line names columns.

    An empty cell is a value that is not given. A spreadsheet's separator may be a semicolon or a tab.
    """
    head: dict[str, Any] = {}
    lines: dict[str, int] = {}
    body: list[tuple[int, str]] = []
    for number, line in enumerate(text.lstrip("\ufeff").splitlines(), start=1):
        bare = line.strip().strip('",;\t').strip()
        if bare.startswith("#"):
            if said := _REMARK.fullmatch(bare):
                head[said[1]], lines[said[1]] = said[2], number
        elif bare:
            body.append((number, line))
    if not body:
        raise PlanError([Mistake(None, "the file has no line that names the columns, such as: point,net,method,high")])
    mark = max(",;\t", key=body[0][1].count)
    columns = [name.strip() for name in _cells(body[0][1], mark)]
    points, wrong = [], []
    for number, line in body[1:]:
        cells = [cell.strip() for cell in _cells(line, mark)]
        if len(cells) > len(columns) and any(cells[len(columns) :]):
            wrong.append(Mistake(number, f"{len(cells)} cells, and there are {len(columns)} columns"))
        values = {name: _plain(name, cell) for name, cell in zip(columns, cells, strict=False) if cell and name}
        points.append(Row(values, number))
    wrong += [Mistake(body[0][0], f"the column {name!r} stands there twice") for name in _twice(columns)]
    return Rows(Row(head, None, lines), Row({}, None), tuple(points), tuple(wrong))


def _cells(line: str, mark: str) -> list[str]:
    return next(csv.reader(io.StringIO(line), delimiter=mark), [])


def _twice(names: list[str]) -> Iterator[str]:
    yield from {name for name in names if name and names.count(name) > 1}


def _plain(column: str, cell: str) -> object:
    """Return a cell as TOML would have it: a number or a truth value where the column is one."""
    if column in ("theta_deg", "touches"):
        try:
            return int(cell) if column == "touches" else float(cell)
        except ValueError:
            return cell
    if column == "second_site":
        return {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}.get(cell.lower(), cell)
    return cell
