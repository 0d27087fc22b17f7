"""The clearance bench on the demonstration board: nothing is hit, and where the figures are wrong it says so."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from tests.bench.clearance.__main__ import cases, row
from tests.bench.clearance.campaign import Case, run

PLACES = 60


@pytest.fixture(scope="module")
def made() -> list[Case]:
    return cases(["demo"], seed=1)


async def test_places_and_corrections_over_a_board_with_parts_hit_nothing(made: list[Case], tmp_path: Path) -> None:
    for case in made:
        tally = await run(case, PLACES, 1, tmp_path, lambda _done: None)
        assert not tally.hits, row(case, tally)
        assert tally.places == PLACES
        rises = tally.rises_um["correct"]
        assert min(rises) < 500.0, "over bare board it hops"


async def test_parts_that_are_higher_than_told_are_hit(made: list[Case], tmp_path: Path) -> None:
    lies = dict.fromkeys(made[0].section.heights_um, 0.0) | {"J": 0.0}
    flat = made[0].section.model_copy(update={"heights_um": lies, "solder_um": 0.0, "lead_um": 0.0, "nest_um": 0.0})
    tally = await run(replace(made[0], section=flat), PLACES, 1, tmp_path, lambda _done: None)
    assert {hit.by for hit in tally.hits} == {"needle"}
