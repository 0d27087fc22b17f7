"""Plan file: a test plan written by a person as TOML or CSV, read for one board; every mistake is told in one go.

A line names a point, or a net; of a net the point that is most accessible is taken, or with `points = "all"` each.
Limits carry their unit. What the file does not say of a point, its `[defaults]` say; but their limits are for points
that give neither limit nor method of their own.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any, Final, get_args

from pydantic import ValidationError

from daemon.config.plan_rows import Mistake, PlanError, PlanForm, Row, Rows, read_rows
from daemon.config.plan_units import parse_value
from daemon.config.problems import nearest
from daemon.domain.board import Board, BoardPoint
from daemon.domain.errors import Fault
from daemon.domain.plan import MOST_TESTS, PLAN_NAME, Plan
from daemon.domain.point_test import UNIT_OF_METHOD, Limits, PointMethod, PointTest

__all__ = ["Mistake", "PlanError", "PlanForm", "read_plan"]
HEAD: Final = ("name", "board", "revision", "nets", "note")
SHARED: Final = ("method", "low", "high", "theta_deg", "look", "touches", "second_site", "points")
KEYS: Final = ("point", "net", *SHARED, "note")
UNLIMITED: Final = frozenset({"contact", "insert"})
"""Methods that need no limits."""


def read_plan(text: str, form: PlanForm, board: Board, name: str) -> Plan:
    """Return the plan that a text says for a board; `name` is what it is called where it does not say so itself.

    Raises `PlanError` with every mistake.
    """
    rows = read_rows(text, form)
    reader = _Reader(board)
    reader.mistakes += rows.mistakes
    name = reader.head(rows.head, name)
    tests = list(reader.tests(rows))
    if not tests and not reader.mistakes:
        cure = 'write [[point]] tables, or nets = "all" under [plan]' if form == "toml" else "add a line for each"
        reader.wrong(None, f"the plan names no point; {cure}")
    if len(tests) > MOST_TESTS:
        reader.wrong(None, f"{len(tests)} points, and a plan has {MOST_TESTS} at most; make two of it")
    if reader.mistakes:
        raise PlanError(reader.mistakes)
    note = str(rows.head.values.get("note", ""))[:500]
    return Plan(name=name, board=board.name, board_revision=board.revision, tests=tuple(tests), note=note)


class _Reader:
    """Turns rows into tests and keeps what is wrong with them."""

    def __init__(self, board: Board) -> None:
        self._board = board
        self._points = {point.name: point for point in board.test_points()}
        self._nets = {point.net for point in board.test_points() if point.net}
        self._taken: dict[tuple[str, str], str] = {}
        self._defaults: Mapping[str, Any] = {}
        self._wrong_defaults = False
        self.mistakes: list[Mistake] = []

    def wrong(self, line: int | None, what: str) -> None:
        """Note a mistake."""
        if (mistake := Mistake(line, what)) not in self.mistakes:  # of a row that stands for many points
            self.mistakes.append(mistake)

    def head(self, row: Row, name: str) -> str:
        """Check what the file says of the plan itself; return its name."""
        self._known(row, HEAD, "[plan]")
        board, name = row.values.get("board"), row.values.get("name", name)
        if board is None:
            self.wrong(row.line, f"the plan does not say for which board it is: board = {self._board.name!r}")
        elif board != self._board.name:
            said = f"the plan is for board {board!r}, this board file is {self._board.name!r}"
            self.wrong(row.line_of("board"), f"{said}; take the plan of this board, or the other board file")
        revision = row.values.get("revision")
        if revision is not None and revision != self._board.revision:
            said = f"the plan is for revision {revision!r} of the board file, this one is {self._board.revision!r}"
            self.wrong(row.line_of("revision"), f"{said}; go through the plan, then write that revision")
        if not isinstance(name, str) or not re.fullmatch(PLAN_NAME, name):
            cure = "letters, digits, _ . + - and no blank, 64 at most"
            self.wrong(row.line_of("name"), f"{name!r} cannot be a plan's name: {cure}")
        return str(name)

    def tests(self, rows: Rows) -> Iterator[PointTest]:
        """Yield the tests of all rows, those of `nets` last."""
        self._known(rows.defaults, SHARED, "[defaults]")
        before = len(self.mistakes)
        self._test(rows.defaults, None, complete=False)  # what is wrong there is told once, and not with each point
        self._wrong_defaults = len(self.mistakes) > before
        self._defaults = {} if self._wrong_defaults else rows.defaults.values
        named: set[str | None] = set()
        for row in rows.points:
            self._known(row, KEYS, "a point")
            points = self._points_of(row)
            named |= {point.net for point in points} | {row.values.get("net")}
            yield from self._tests_of(self._whole(row), points)
        for net in self._nets_of(rows.head, named):
            row = self._whole(Row({"net": net}, rows.head.line_of("nets")))
            yield from self._tests_of(row, self._points_of(row))

    def _whole(self, row: Row) -> Row:
        """Return a row with what the defaults add to it."""
        own = {"low", "high", "method"} & row.values.keys()
        added = {key: value for key, value in self._defaults.items() if not (own and key in ("low", "high"))}
        return Row({**added, **row.values}, row.line, row.lines)

    def _tests_of(self, row: Row, points: tuple[BoardPoint, ...]) -> Iterator[PointTest]:
        if not points:
            self._test(row, None)  # what else is wrong with it is told now, and not next time
        for point in points:
            test = self._test(row, point)
            if test is None:
                return  # the same is wrong with each point of a net
            key, here = (test.point, test.method), f"line {row.line}" if row.line is not None else "the file"
            if key in self._taken:
                self.wrong(row.line, f"{test.point} is tested by {test.method} already, in {self._taken[key]}")
                continue
            self._taken[key] = here
            yield test

    def _nets_of(self, head: Row, named: set[str | None]) -> list[str]:
        """Return the nets that `nets` asks for and no row names."""
        nets, line = head.values.get("nets"), head.line_of("nets")
        if nets is None:
            return []
        if nets == "all":
            return sorted(self._nets - named, key=str)
        if not isinstance(nets, list) or not all(isinstance(net, str) for net in nets):
            self.wrong(line, 'nets is "all", or a list of names such as ["GND", "VCC"]')
            return []
        return [net for net in dict.fromkeys(nets) if net not in named]

    def _points_of(self, row: Row) -> tuple[BoardPoint, ...]:
        """Return the points that a row means."""
        name, net = row.values.get("point"), row.values.get("net")
        which = row.values.get("points", self._defaults.get("points", "best"))
        if which not in ("best", "all"):
            self.wrong(row.line_of("points"), f'points is "best" (one point a net) or "all", not {which!r}')
        if name is None and net is None:
            self.wrong(row.line, "name a point or a net")
            return ()
        if name is not None:
            return self._point(row, str(name), net)
        if net not in self._nets:
            why = self._board.unserved.get(str(net))
            said = f"net {net!r} cannot be touched on this side: {why}" if why else f"the board has no net {net!r}"
            self.wrong(row.line_of("net"), said + ("" if why else nearest(str(net), map(str, self._nets))))
            return ()
        points = self._board.of_net(str(net))
        return points if which == "all" else points[:1]

    def _point(self, row: Row, name: str, net: object) -> tuple[BoardPoint, ...]:
        point = self._points.get(name)
        if point is None:
            try:
                self._board.point(name)
            except Fault as why:
                self.wrong(row.line_of("point"), why.message + nearest(name, self._points))
            return ()
        if net is not None and net != point.net:
            self.wrong(row.line_of("net"), f"{name} is on net {point.net}, and not on {net}")
            return ()
        return (point,)

    def _test(self, row: Row, point: BoardPoint | None, *, complete: bool = True) -> PointTest | None:
        """Return the test of a point; None, with the mistake noted, where the row is wrong.

        Without a point the row is only checked. Not `complete`: it is one of defaults, and may lack anything.
        """
        method = row.values.get("method", "continuity")
        if method not in get_args(PointMethod):
            known = ", ".join(get_args(PointMethod))
            meant = nearest(str(method), get_args(PointMethod))
            self.wrong(row.line_of("method"), f"there is no method {method!r}; there are {known}{meant}")
            return None
        before = len(self.mistakes)
        limits = self._limits(row, method, complete=complete)
        fields = {key: row.values[key] for key in ("theta_deg", "look", "touches", "second_site") if key in row.values}
        if point is not None and "note" in row.values:
            fields["note"] = row.values["note"]
        try:
            test = PointTest.model_validate(
                {"point": point.name if point else "?", "net": point.net if point else None, "method": method,
                 "limits": limits, **fields}, strict=True,
            )  # fmt: skip
        except ValidationError as exc:
            for error in exc.errors(include_url=False):
                key = str(error["loc"][0]) if error["loc"] else ""
                self.wrong(row.line_of(key), f"{key} = {row.values.get(key)!r}: {error['msg']}")
            return None
        return test if len(self.mistakes) == before else None

    def _limits(self, row: Row, method: PointMethod, *, complete: bool) -> Limits | None:
        unit, ends = UNIT_OF_METHOD[method], {}
        for end in ("low", "high"):
            if (given := row.values.get(end)) is None:
                continue
            if unit is None:
                self.wrong(row.line_of(end), f"{method} measures nothing, and takes no {end}")
                continue
            try:
                ends[end] = parse_value(given, unit)
            except ValueError as exc:
                self.wrong(row.line_of(end), f"{end} = {exc}")
        if unit is not None and not ends and complete and method not in UNLIMITED:
            if row.values.get("low") is None and row.values.get("high") is None and not self._wrong_defaults:
                self.wrong(row.line, f'{method} needs a limit: low, high, or both, such as high = "2 {unit}"')
            return None
        try:
            return Limits(**ends, unit=unit) if ends and unit is not None else None
        except ValidationError as exc:
            self.wrong(row.line_of("low"), exc.errors()[0]["msg"].removeprefix("Value error, "))
            return None

    def _known(self, row: Row, keys: tuple[str, ...], where: str) -> None:
        for key in row.values:
            if key not in keys:
                listed = "" if (meant := nearest(key, keys)) else f"; there are {', '.join(keys)}"
                self.wrong(row.line_of(key), f"{where} has no {key!r}{meant}{listed}")
