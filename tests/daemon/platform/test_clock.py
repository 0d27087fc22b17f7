"""Where time went."""

import pytest

from daemon.platform.clock import Stopwatch


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
