"""A tip that was measured is carried to where the ground hides it: for a while, and not where it is to be measured."""

from __future__ import annotations

from typing import Any

import pytest

from daemon.station import tip_search
from daemon.station.tip_search import CARRIED_S, MOST_CARRIED, TipSearch
from tests.daemon.procedures.fake_station import found_tip, frame, missing, probe_model
from vision import NotFound, ProbeModel, Reason, Tip

WHOLE, CARRIED, HIDDEN = found_tip(800.0, 600.0), found_tip(801.0, 600.0), missing(Reason.WRONG_NEEDLE)
MODEL = probe_model()


class Eyes:
    """Vision that answers as told, and a clock."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.tip: Tip | NotFound = WHOLE
        self.carried: Tip | None = CARRIED
        self.now_s = 100.0
        monkeypatch.setattr(tip_search, "find_tip", lambda *_: self.tip)
        monkeypatch.setattr(tip_search, "KnownTip", self)
        monkeypatch.setattr(tip_search.time, "monotonic", lambda: self.now_s)

    def of(self, _pixels: Any, _tip: Tip, model: ProbeModel) -> Any:
        self.model = model
        return self

    def carried_to(self, _pixels: Any) -> Tip | None:
        return self.carried


@pytest.fixture
def eyes(monkeypatch: pytest.MonkeyPatch) -> Eyes:
    return Eyes(monkeypatch)


async def _hidden_after_a_whole_one(eyes: Eyes, search: TipSearch, **how: Any) -> Tip | NotFound | None:
    eyes.tip = WHOLE
    assert await search.find(frame(1), MODEL) is WHOLE
    eyes.tip = HIDDEN
    return await search.find(frame(2), MODEL, **how)


async def test_a_hidden_tip_is_carried_from_where_it_was_measured(eyes: Eyes) -> None:
    assert await _hidden_after_a_whole_one(eyes, TipSearch()) is CARRIED


async def test_what_cannot_be_carried_is_refused_as_it_was(eyes: Eyes) -> None:
    eyes.carried = None
    assert await _hidden_after_a_whole_one(eyes, TipSearch()) is HIDDEN


async def test_where_nothing_was_measured_nothing_is_carried(eyes: Eyes) -> None:
    eyes.tip = HIDDEN
    search = TipSearch()
    assert await search.find(frame(1), MODEL) is HIDDEN
    assert await search.find(frame(1), None) is None


async def test_for_a_calibration_the_tip_is_measured(eyes: Eyes) -> None:
    assert await _hidden_after_a_whole_one(eyes, TipSearch(), measured=True) is HIDDEN


@pytest.mark.parametrize("reason", [Reason.TOO_DARK, Reason.SATURATED, Reason.BLURRED, Reason.OUT_OF_FRAME])
async def test_nothing_is_carried_to_a_picture_that_is_no_good(eyes: Eyes, reason: Reason) -> None:
    search = TipSearch()
    await search.find(frame(1), MODEL)
    eyes.tip = missing(reason)
    assert await search.find(frame(2), MODEL) is eyes.tip


async def test_a_needle_taught_again_or_forgotten_is_not_the_one_that_was_measured(eyes: Eyes) -> None:
    search = TipSearch()
    assert await _hidden_after_a_whole_one(eyes, search) is CARRIED
    eyes.model = probe_model()
    assert await search.find(frame(3), MODEL) is HIDDEN
    assert await _hidden_after_a_whole_one(eyes, search) is CARRIED
    search.forget()
    assert await search.find(frame(4), MODEL) is HIDDEN


async def test_it_is_carried_for_so_long_and_so_often(eyes: Eyes) -> None:
    """It should begin again with each tip that is measured whole."""
    search = TipSearch()
    for _ in range(2):
        assert await _hidden_after_a_whole_one(eyes, search) is CARRIED
        for number in range(MOST_CARRIED - 1):
            assert await search.find(frame(number), MODEL) is CARRIED
        assert await search.find(frame(9), MODEL) is HIDDEN
    assert await _hidden_after_a_whole_one(eyes, search) is CARRIED
    eyes.now_s += CARRIED_S
    assert await search.find(frame(9), MODEL) is HIDDEN
