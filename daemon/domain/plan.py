"""Test plan: which points of one board are tested, how, and by which limits; with its fingerprint.

A plan belongs to one board: to its name, and to the fingerprint of its board file. The plan's own fingerprint covers
all that decides how a board is tested, and nothing else: neither its name, nor remarks, nor who approved it.
"""

from __future__ import annotations

import hashlib
import json
from functools import cached_property
from typing import Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from daemon.domain.board import Board
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.point_test import PointTest
from daemon.domain.results import Told

PLAN_NAME = r"^[A-Za-z0-9][A-Za-z0-9_.+-]{0,63}$"
"""A plan's name is also that of its folder."""
MOST_TESTS = 5000
POINTS_ALONE = "points"
"""Name of a plan that was given as a list of points, and is stored nowhere."""


class Plan(BaseModel):
    """What is asked about one board."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str = Field(pattern=PLAN_NAME)
    board: str = Field(description="the board file's name of the board")
    board_revision: str = Field(description="fingerprint of the board file it was written for")
    tests: tuple[PointTest, ...] = Field(min_length=1, max_length=MOST_TESTS)
    learned_from: tuple[str, ...] = Field(default=(), description="runs on boards known to be good")
    note: str = Field(default="", max_length=500)

    @model_validator(mode="after")
    def _each_once(self) -> Self:
        seen: set[tuple[str, str]] = set()
        for test in self.tests:
            key = (test.point, test.method)
            if key in seen:
                raise ValueError(f"{test.point} is tested twice by {test.method}")
            seen.add(key)
        return self

    @property
    def learned(self) -> bool:
        """Whether its limits come from measurements, and a person has to look at them before it is used."""
        return bool(self.learned_from)

    @cached_property
    def hash(self) -> str:
        """Fingerprint of board and tests in their order, 16 hexadecimal digits."""
        tests = [test.model_dump(mode="json", exclude={"note"}) for test in self.tests]
        canonical = {"board": self.board, "board_revision": self.board_revision, "tests": tests}
        text = json.dumps(canonical, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def require_board(self, board: Board) -> None:
        """Raise `Fault` where the plan is for another board than this one, or for another file of it."""
        if self.board != board.name:
            raise Fault(
                FaultCode.WRONG_PLAN,
                f"plan {self.name} is for board {self.board}, the station has {board.name}",
                plan=self.name,
            )
        if self.board_revision != board.revision:
            raise Fault(
                FaultCode.WRONG_PLAN,
                f"plan {self.name} was written for revision {self.board_revision} of {self.board}; "
                f"the station's board file is {board.revision}",
                plan=self.name,
                advice=f"check the plan by this board file, write revision = {board.revision!r} into it, and store it",
            )


class Approval(Told):
    """A person looked at a plan and took it for good."""

    by: str
    at: str = Field(description="UTC, ISO 8601")


class StoredPlan(Told):
    """One version of a plan, as it is kept."""

    version: int
    plan: Plan
    hash: str
    stored_at: str = Field(description="UTC, ISO 8601")
    stored_by: str
    approved: Approval | None = None

    def require_approved(self) -> None:
        """Raise `Fault` for a plan with learned limits at which no person has looked."""
        if self.plan.learned and self.approved is None:
            name = self.plan.name
            raise Fault(
                FaultCode.PLAN_NOT_APPROVED,
                f"the limits of plan {name}, version {self.version}, were learned and nobody has approved them",
                advice=f"look at them (`reprobe plan show {name}`), then `reprobe plan approve {name}`",
                plan=name,
                version=self.version,
            )


def plan_of_points(board: Board, names: tuple[str, ...]) -> Plan:
    """Return a plan that asks of each point only whether contact is made; raise `Fault` for one that cannot be."""
    tests = tuple(PointTest(point=point.name, net=point.net, method="contact") for point in map(board.point, names))
    return Plan(name=POINTS_ALONE, board=board.name, board_revision=board.revision, tests=tests)
