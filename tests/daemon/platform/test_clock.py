"""Where time went."""

import pytest

from daemon.platform.clock import Stopwatch, clock_behind, utc_now


def test_what_is_not_waited_for_is_software() -> None:
    watch = Stopwatch()
    watch.enter("look")
    watch.book("exposure", 0.0)
    watch.book("light", -1.0)
    watch.enter("move")
    timing = watch.timing_ms()
    assert timing["look"]["light"] == 0.0
    assert timing["look"]["software"] == pytest.approx(timing["look"]["total"], abs=0.02)
    assert set(timing) == {"triggered", "look", "move"}


@pytest.mark.parametrize(
    ("now", "last", "says"),
    [
        ("1970-01-01T00:00:05.000+00:00", "", "younger"),
        ("2026-03-01T12:00:00.000+00:00", "2026-11-25T08:00:00.000+00:00", "2026-11-25T08:00"),
        ("2026-11-25T08:00:00.000+00:00", "2026-11-25T08:05:00.000+00:00", None),
        ("2026-11-25T08:00:00.000+00:00", "2026-03-01T12:00:00.000+00:00", None),
        (utc_now(), "", None),
    ],
)
def test_a_clock_that_must_be_behind_is_told_by_what_was_written_before(now: str, last: str, says: str | None) -> None:
    told = clock_behind(now, last)
    assert (told is None) == (says is None)
    assert says is None or says in (told or "")
