"""A share is compared with the station's own by an exact test; a creep and a jump are found, chance is not."""

import json
import random

import pytest
from scipy.stats import binomtest

from daemon.maintenance.catalogue import chosen
from daemon.maintenance.proportion_test import ALPHA, Share, ShareSettings

CORRECTIONS = ShareSettings()
FEW = ShareSettings(block=2, windows=(1, 3, 5, 10), least=60, most=2000, times=2.0, ceiling=0.05)


def _fed(share: Share, chance: float, blocks: int, seed: int, start: int = 0) -> Share:
    rng = random.Random(seed)
    for k in range(blocks):
        share.feed(sum(rng.random() < chance for _ in range(100)), 100, (start + k + 1) * 100, f"t{start + k}")
    return share


def test_five_percent_that_stay_five_percent_are_silent() -> None:
    for seed in range(20):
        assert _fed(Share(CORRECTIONS), 0.05, 150, seed).finding is None


def test_five_percent_that_become_ten_are_found_with_both_figures() -> None:
    share = _fed(_fed(Share(CORRECTIONS), 0.05, 60, 1), 0.10, 40, 2, 60)
    assert share.finding is not None
    assert share.finding.figure == pytest.approx(0.10, abs=0.03)
    assert share.finding.usual == pytest.approx(0.05, abs=0.015)
    assert share.finding.since_touches > 4000


def test_it_agrees_with_the_exact_conditional_test() -> None:
    """The last block is found exactly when the binomial test of it, given the total, says so."""
    for events in range(15, 45):
        share = Share(ShareSettings(block=100, windows=(1,), least=1000, times=1.0))
        for k in range(40):
            share.feed(5, 100, k, "t")
        share.feed(events, 100, 41, "t")
        p = binomtest(events, events + 200, 100 / 4100, alternative="greater").pvalue
        assert (share.finding is not None) == (p < ALPHA)


def test_fewer_than_usual_is_no_trouble() -> None:
    assert _fed(_fed(Share(CORRECTIONS), 0.05, 60, 1), 0.0, 60, 2, 60).finding is None


def test_it_is_cleared_when_the_share_is_again_what_it_was() -> None:
    share = _fed(_fed(Share(CORRECTIONS), 0.05, 60, 1), 0.25, 5, 2, 60)
    assert share.finding is not None
    assert _fed(share, 0.05, 80, 3, 65).finding is None


def test_what_is_wrong_does_not_become_what_is_usual() -> None:
    share = _fed(_fed(Share(CORRECTIONS), 0.05, 30, 1), 0.15, 300, 2, 30)
    assert share.finding is not None


def test_a_station_that_was_bad_from_the_start_is_told_by_the_ceiling() -> None:
    share = Share(FEW)
    for k in range(6):
        share.feed(1, 1, k, "t")
    assert share.finding is not None
    assert "ever good" in share.finding.rule
    for k in range(60):
        share.feed(0, 1, k, "t")
    assert share.finding is None


def test_the_limit_that_is_shown_is_where_the_test_begins_to_speak() -> None:
    settings = ShareSettings(block=100, windows=(1,), least=1000, times=1.0)

    def after(events: int) -> Share:
        share = Share(settings)
        for k in range(40):
            share.feed(5, 100, k, "t")
        share.feed(events, 100, 41, "t")
        return share

    limit = after(5).standing.high
    assert limit is not None
    assert after(round(100 * limit)).finding is not None
    assert after(round(100 * limit) - 1).finding is None


def test_a_rare_failure_is_no_finding() -> None:
    share = Share(FEW)
    for k in range(1000):
        share.feed(int(k % 97 == 0), 1, k, "t")
        assert share.finding is None


def test_it_goes_on_where_it_was_after_it_was_kept() -> None:
    whole = _fed(_fed(Share(CORRECTIONS), 0.05, 60, 1), 0.10, 40, 2, 60)
    half = _fed(Share(CORRECTIONS), 0.05, 60, 1)
    again = Share.from_dict(CORRECTIONS, json.loads(json.dumps(half.to_dict())))
    assert _fed(again, 0.10, 40, 2, 60).to_dict() == whole.to_dict()


def _on_boards(share: Share, seed: int, blocks: int, mean: float = 0.05) -> Share:
    """Feed blocks of 100 touches on boards of 200 whose own shares differ: gamma, half its square as variance."""
    rng = random.Random(seed)
    chance = mean
    for k in range(blocks):
        if k % 2 == 0:
            chance = min(1.0, rng.gammavariate(2.0, mean / 2.0))
        share.feed(sum(rng.random() < chance for _ in range(100)), 100, (k + 1) * 100, f"t{k}")
    return share


def test_corrections_that_come_board_by_board_are_silent_and_said_to_hang_together() -> None:
    settings = chosen((), off=(), baseline=60, batch=5)["correction_share"].settings
    assert isinstance(settings, ShareSettings)
    assert not [seed for seed in range(40) if _on_boards(Share(settings), seed, 100).finding]
    assert _on_boards(Share(CORRECTIONS), 1, 400).dispersion > 3.0
    assert _fed(Share(CORRECTIONS), 0.05, 400, 1).dispersion < 2.0


def test_a_share_that_grows_threefold_is_found_even_on_such_boards() -> None:
    share = _on_boards(Share(CORRECTIONS), 1, 100)
    assert share.finding is None
    assert _on_boards(share, 2, 100, mean=0.15).finding is not None


def test_one_burst_on_a_clean_line_is_no_finding_where_bursts_are_expected() -> None:
    line = Share(ShareSettings(block=100, windows=(1, 5, 20), least=1000, absolute=3e-4, clump=3.0, most=90_000))
    for k in range(300):
        line.feed(3 if k in (150, 153) else 0, 320, k, "t")
        assert line.finding is None
    for k in range(60):
        line.feed(2, 320, 300 + k, "t")
    assert line.finding is not None
