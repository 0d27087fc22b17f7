"""Run over a board: one board tested by one plan, over as many jobs as it takes, and the figures of it.

A run begins with the job that asked for it, and bears its id. A job that is stopped or killed leaves it unfinished, and
a later one goes on with it: no point that has a verdict is touched again.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Literal

from pydantic import Field

from daemon.domain.counted import counted
from daemon.domain.plan import Plan
from daemon.domain.point_test import PointRecord, PointTest, PointVerdict, Rung
from daemon.domain.results import Told

RunState = Literal["unfinished", "done", "abandoned"]
TESTED = frozenset(PointVerdict) - {PointVerdict.NOT_TESTED}


class RunPlace(Told):
    """Where a test of a run is made."""

    x_um: float = Field(description="board frame")
    y_um: float
    theta_deg: float | None = Field(description="angle of the head; null: it cannot be reached at any")


class RunBoard(Told):
    """The board as it was when the run began, for its map."""

    name: str
    side: str
    revision: str
    width_um: float
    height_um: float


class RunSummary(Told):
    """Figures of a run so far."""

    points: int = Field(description="of the plan")
    done: int = Field(description="with a verdict")
    first_touch_yield: float | None = Field(description="share of the tested points that passed at the first touch")
    passed_first: int
    false_opens: int = Field(description="no pass at the first touch, and good in the end")
    recovered_by: dict[str, int] = Field(description="rung -> false opens that it cured")
    causes: dict[str, int] = Field(description="cause -> false opens that it made")
    opens_confirmed: int
    failed: int
    contact_not_made: int
    not_tested: int
    touches: int = Field(description="descents onto pads, of all points")
    touches_mean: float | None = Field(description="of a tested point")
    touches_p99: int | None
    touches_max: int | None
    looks: int
    seconds: float = Field(description="spent on points, without the way between jobs")
    seconds_per_point: float | None
    reference_first_ohm: float | None = Field(description="the reference pad, when it was first touched in this run")
    reference_last_ohm: float | None


class BoardRun(Told):
    """One run: what was asked, in which order, and how it stands."""

    id: str
    board_id: str
    plan: Plan
    plan_version: int | None = Field(description="null where points were named instead of a plan")
    plan_hash: str
    board: RunBoard
    order: tuple[int, ...] = Field(description="numbers of the plan's tests in the order of the way, from 0")
    places: tuple[RunPlace, ...] = Field(description="of the plan's tests")
    station: str
    software: str
    calibrated: dict[str, str] = Field(description="calibration -> when it was made, as the run began")
    begun_at: str = Field(description="UTC, ISO 8601")
    ended_at: str | None = None
    state: RunState = "unfinished"
    jobs: tuple[str, ...] = Field(description="that worked on it, the first one named it")
    stopped_by: str = Field(default="", description="why the last job left it unfinished")
    summary: RunSummary | None = None

    def tests_left(self, records: Sequence[PointRecord]) -> list[tuple[PointTest, RunPlace]]:
        """Return the tests without a verdict with their places, in the order of the way."""
        done = {(record.point, record.method) for record in records}
        tests = [(self.plan.tests[n], self.places[n]) for n in self.order]
        return [(test, place) for test, place in tests if (test.point, test.method) not in done]


def summarise(points: int, records: Sequence[PointRecord], reference_ohm: Sequence[float] = ()) -> RunSummary:
    """Return the figures of a run of so many points by its records, in their order; with readings of the reference.

    What was not tested counts in no share and no mean.
    """
    tested = [record for record in records if record.verdict in TESTED]
    verdicts = Counter(record.verdict for record in records)
    recovered = [record for record in records if record.verdict is PointVerdict.PASS_RECOVERED]
    touches = sorted(record.touches for record in tested)
    seconds = sum(record.seconds for record in records)
    count = len(tested)
    return RunSummary(
        points=points,
        done=len(records),
        first_touch_yield=verdicts[PointVerdict.PASS_FIRST] / count if count else None,
        passed_first=verdicts[PointVerdict.PASS_FIRST],
        false_opens=len(recovered),
        recovered_by=dict(Counter((record.recovered_by or Rung.TOUCH).value for record in recovered)),
        causes=dict(Counter(record.cause.value if record.cause else "unknown" for record in recovered)),
        opens_confirmed=verdicts[PointVerdict.OPEN_CONFIRMED],
        failed=verdicts[PointVerdict.FAIL],
        contact_not_made=verdicts[PointVerdict.CONTACT_NOT_MADE],
        not_tested=verdicts[PointVerdict.NOT_TESTED],
        touches=sum(record.touches for record in records),
        touches_mean=sum(touches) / count if count else None,
        touches_p99=touches[math.ceil(0.99 * count) - 1] if count else None,
        touches_max=touches[-1] if count else None,
        looks=sum(record.looks for record in records),
        seconds=round(seconds, 3),
        seconds_per_point=round(sum(record.seconds for record in tested) / count, 3) if count else None,
        reference_first_ohm=reference_ohm[0] if reference_ohm else None,
        reference_last_ohm=reference_ohm[-1] if reference_ohm else None,
    )


def in_a_sentence(summary: RunSummary) -> str:
    """Say how a run went, for people."""
    rungs = ", ".join(f"{count} by {rung.replace('_', ' ')}" for rung, count in summary.recovered_by.items())
    parts = [
        f"{summary.done} of {summary.points} points",
        f"{summary.passed_first} passed at the first touch",
        f"{counted(summary.false_opens, 'false open')} recovered" + (f" ({rungs})" if rungs else ""),
        f"{counted(summary.opens_confirmed, 'open')} confirmed",
        f"{summary.failed} failed",
        f"{summary.contact_not_made} without contact",
        f"{summary.not_tested} not tested",
    ]
    pace = f"; {summary.seconds_per_point:.2f} s a point" if summary.seconds_per_point is not None else ""
    return ", ".join(parts) + pace
