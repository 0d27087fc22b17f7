"""A chart learns what is usual, finds jumps, shifts and creeps, keeps silent on chance, and forgets when it is told."""

import json
import math
import random
import statistics
from dataclasses import replace

import pytest

from daemon.maintenance.types import Point
from daemon.maintenance.xmr_chart import Chart, ChartSettings, ControlLimits, learn

PLAIN = ChartSettings(baseline=60, batch=5)


def _fed(chart: Chart, values: list[float], start: int = 0) -> Chart:
    for k, value in enumerate(values):
        chart.feed(Point(value, (start + k) * 20, f"2026-11-01T00:00:{(start + k) % 60:02d}", f"job-{start + k}"))
    return chart


def _normal(n: int, mean: float = 0.0, sigma: float = 1.0, seed: int = 1) -> list[float]:
    rng = random.Random(seed)
    return [rng.gauss(mean, sigma) for _ in range(n)]


def _learned(values: list[float], batch: int = 5, *, together: bool = False) -> ControlLimits:
    points = [statistics.median(values[k : k + batch]) for k in range(0, len(values), batch)]
    return learn(values, points, batch, together=together)


def test_what_is_usual_is_the_mean_of_points_and_the_moving_range_tells_the_scatter() -> None:
    limits = _learned(_normal(2000, mean=30.0, sigma=4.0), batch=5)
    assert limits.centre == pytest.approx(30.0, abs=0.3)
    assert limits.sigma == pytest.approx(4.0 * 1.2 / math.sqrt(5), rel=0.1)


def test_short_baselines_get_wider_limits_than_long_ones() -> None:
    short, long = _learned(_normal(20)), _learned(_normal(1000))
    assert short.far > 1.5 * long.far
    assert long.far == pytest.approx(5.0, rel=0.03)


def test_accidents_in_the_baseline_do_not_make_the_limits_useless() -> None:
    values = _normal(60)
    values[30], values[44] = 300.0, -50.0
    assert _learned(values).sigma < 2.0 / math.sqrt(5)
    assert abs(_learned(values).centre) < 0.5


def test_numbers_of_one_board_hang_together_and_only_their_points_tell_the_scatter() -> None:
    boards = [board + v for k, board in enumerate(_normal(60, sigma=5.0)) for v in _normal(5, seed=k)]
    assert _learned(boards).sigma == pytest.approx(5.0, rel=0.25), "seen in the points"
    few = _learned(boards[:60], together=True)
    assert few.far > 1.4 * _learned(_normal(60)).far, "twelve points know little"


def test_a_board_on_which_many_fail_is_one_point_however_many_they_are() -> None:
    chart = Chart(replace(PLAIN, spread=100))
    for k in range(60):
        chart.feed(Point(float(k % 7), k * 25, ""))
    assert chart.limits is not None
    for _ in range(19):
        chart.feed(Point(500.0, 1600, ""))
    assert chart.standing.figure is None, "all within 100 touches: no point yet"
    chart.feed(Point(500.0, 1600, ""))
    assert chart.standing.figure == 500.0, "but full in the end, for a tester may never report its touches"


def test_what_was_learned_is_refined_unless_the_numbers_have_moved() -> None:
    steady = _fed(Chart(PLAIN), _normal(60))
    first = steady.limits
    _fed(steady, _normal(200, seed=2))
    assert steady.limits is not None
    assert first is not None
    assert steady.limits.creep < first.creep
    moved = _fed(Chart(replace(PLAIN, floor=50.0)), _normal(60) + _normal(200, mean=3.0, seed=2))
    assert moved.limits is not None
    assert moved.limits.centre == pytest.approx(first.centre, abs=0.01), "a creep must not become what is usual"


@pytest.mark.parametrize(
    ("shift", "side", "rule"),
    [(6.0, 1, "one point far off"), (2.6, 1, "points off"), (-1.4, -1, "in a row"), (6.0, -1, "far off")],
)
def test_each_rule_finds_its_kind_of_change(shift: float, side: int, rule: str) -> None:
    shift = side * abs(shift)
    chart = _fed(Chart(PLAIN), _normal(60))
    rules = []
    for k in range(40):
        _fed(chart, _normal(5, mean=shift, seed=100 + k), 60 + 5 * k)
        if chart.finding is not None:
            rules.append(chart.finding.rule)
    assert any(rule in found for found in rules)
    assert chart.finding is not None
    assert math.copysign(1.0, chart.finding.figure - (chart.finding.usual or 0.0)) == side


def test_a_one_sided_chart_is_silent_on_the_good_side() -> None:
    chart = _fed(Chart(replace(PLAIN, side="high")), _normal(60) + _normal(100, mean=-5.0, seed=2))
    assert chart.finding is None
    assert _fed(chart, _normal(10, mean=9.0, seed=3)).finding is not None


def test_a_change_nobody_would_act_on_is_no_finding_however_certain() -> None:
    values = _normal(60, 100.0, 0.01) + _normal(100, 101.0, 0.01, seed=2)
    assert _fed(Chart(PLAIN), values).finding is not None
    assert _fed(Chart(replace(PLAIN, floor=2.0)), values).finding is None
    assert _fed(Chart(replace(PLAIN, floor_share=0.02)), values).finding is None


def test_a_finding_says_since_when_and_on_what_it_rests() -> None:
    chart = _fed(Chart(PLAIN), _normal(100) + _normal(60, mean=3.0, seed=2))
    assert chart.finding is not None
    assert chart.finding.since_touches == pytest.approx(100 * 20, abs=300)
    assert "job-" in chart.finding.evidence[-1]


def test_it_is_cleared_when_the_numbers_are_again_what_they_were() -> None:
    chart = _fed(Chart(PLAIN), _normal(60) + _normal(20, mean=8.0, seed=2))
    assert chart.finding is not None
    assert _fed(chart, _normal(15, seed=3)).finding is not None, "not at the first good point"
    assert _fed(chart, _normal(60, seed=4)).finding is None


def test_it_begins_anew_when_it_is_told() -> None:
    chart = _fed(Chart(PLAIN), _normal(60) + _normal(20, mean=8.0, seed=2))
    chart.restart()
    assert chart.finding is None
    assert chart.standing.learned == 0.0
    assert _fed(chart, _normal(160, mean=8.0, seed=3)).finding is None


def test_points_do_not_mind_numbers_that_are_quite_wrong() -> None:
    rng = random.Random(5)

    def mixed(n: int) -> list[float]:
        return [rng.gauss(40.0 if rng.random() < 0.03 else 0.0, 1.0) for _ in range(n)]

    assert _fed(Chart(PLAIN), mixed(500)).finding is None


def test_numbers_that_are_none_are_left_out() -> None:
    chart = _fed(Chart(PLAIN), [math.nan, math.inf] * 40)
    assert chart.standing.learned == 0.0


def test_a_chart_goes_on_where_it_was_after_it_was_kept() -> None:
    values = _normal(100) + _normal(60, mean=3.0, seed=2)
    for cut in (10, 63, 110, 150):
        whole = _fed(Chart(PLAIN), values)
        first = _fed(Chart(PLAIN), values[:cut])
        again = Chart.from_dict(PLAIN, json.loads(json.dumps(first.to_dict())))
        assert _fed(again, values[cut:], cut).to_dict()["points"][-1] == whole.to_dict()["points"][-1]
        assert (again.finding is None) == (whole.finding is None)


def test_a_baseline_that_is_too_short_for_its_batches_is_refused() -> None:
    with pytest.raises(ValueError, match="too short"):
        ChartSettings(baseline=8, batch=5)
