"""The fault campaign's judge on a daemon that is broken on purpose: it says what it is there to say."""

from __future__ import annotations

import pytest

from tests.bench.faults.campaign import PARTS, Plan, run

SPEED = 5.0
SEED, CANCELS = 27_677, 4
"""With these dice all four items cancel a surface calibration within 80 ms after the pin was pressed."""


@pytest.mark.parametrize(("how", "kind"), [("pressed", "pressed at rest"), ("sideways", "sideways while pressed")])
def test_a_broken_daemon_is_found_out(how: str, kind: str) -> None:
    counts = dict.fromkeys(PARTS, 0) | {"cancels": CANCELS}
    program = ("tests.bench.faults.broken", how)
    tally = run(Plan(SEED, counts, 1, 1, SPEED, program=program), lambda _text: None)
    assert kind in [violation.kind for violation in tally.violations], tally


def test_a_sound_daemon_passes_the_same_items() -> None:
    counts = dict.fromkeys(PARTS, 0) | {"cancels": CANCELS}
    tally = run(Plan(SEED, counts, 1, 1, SPEED), lambda _text: None)
    assert tally.violations == []
    assert tally.done == {"cancels": CANCELS}
