"""Each rule's limit: what lies at it, and what lies just beyond."""

from __future__ import annotations

from dataclasses import replace
from math import inf, nextafter

import numpy as np
import pytest

from vision.core.circle_fit import CircleFit, Contour
from vision.pads import rules
from vision.pads.rules import Hole, Rule, SeenObject, Verdict, Wanted, decide, is_clear, is_round, is_via, sound

TAKE, THROW, PASS = Verdict.TAKE, Verdict.THROW, Verdict.PASS
CIRCLE = CircleFit(
    50.0, 50.0, 17.0, 0.87, 1.0, 0.03, 1.0, 0.95, 0.01, 0.05, np.ones(48, bool), Contour(50.0, 50.0, 17.0)
)
PAD = SeenObject(
    50.0, 50.0, 900.0, 34.0, 34.0, 1.0, 0.785, 1.0, 190.0, 150.0, 0.0, False, 0.0, False, False, CIRCLE, None, 5.0
)
HOLE = Hole(50.0, 50.0, 5.0, 0.05)
ANY = Wanted(None, 190.0, 150.0)


def less(value: float) -> float:
    return nextafter(value, -inf)


def more(value: float) -> float:
    return nextafter(value, inf)


def pad(circle: dict[str, float] | None = None, **change: object) -> SeenObject:
    """Return a good pad, its circle and itself changed."""
    return replace(PAD, circle=replace(CIRCLE, **(circle or {})), **change)


def blob(**change: object) -> SeenObject:
    """Return an object without a circle."""
    return replace(PAD, circle=None, **change)


THROWN_BY: list[tuple[Rule, SeenObject, Wanted, Verdict]] = [
    (rules.small, pad(area_px=rules.LEAST_AREA_PX), ANY, PASS),
    (rules.small, pad(area_px=less(rules.LEAST_AREA_PX)), ANY, THROW),
    (rules.faint, pad(level=60.0, contrast=rules.FAINT_CONTRAST), ANY, PASS),
    (rules.faint, pad(level=60.0, contrast=less(rules.FAINT_CONTRAST)), ANY, THROW),
    (rules.faint, pad(level=200.0, contrast=rules.MOST_COVERED), ANY, PASS),
    (rules.faint, pad(level=200.0, contrast=less(rules.MOST_COVERED)), ANY, THROW),
    (rules.thin, blob(length_px=4.0 * rules.THIN_RATIO, thickness_px=4.0), ANY, PASS),
    (rules.thin, blob(length_px=more(4.0 * rules.THIN_RATIO), thickness_px=4.0), ANY, THROW),
    (rules.thin, blob(length_px=4.0, thickness_px=1.0), ANY, PASS),
    (rules.thin, blob(length_px=4.0, thickness_px=0.5), ANY, THROW),
    (rules.thin, blob(length_px=4.0, thickness_px=0.0), ANY, THROW),
    (rules.thin, pad(length_px=60.0, thickness_px=1.0), ANY, PASS),
    (rules.needle, blob(in_needle=rules.PROBE_SHARE), ANY, PASS),
    (rules.needle, blob(in_needle=more(rules.PROBE_SHARE)), ANY, THROW),
    (rules.needle, pad(in_needle=1.0), ANY, PASS),
    (rules.wrong_size, blob(), Wanted(42.0, 190.0), PASS),
    (rules.wrong_size, pad(), ANY, PASS),
    (rules.wrong_size, pad(), Wanted(17.0, 190.0), PASS),
    (rules.wrong_size, pad(), Wanted(42.0, 190.0), THROW),
    (rules.wrong_size, pad({"coverage": 0.3}), Wanted(42.0, 190.0), PASS),
    (rules.wrong_size, pad({"radius_px": 42.0}), ANY, PASS),
    (rules.wrong_size, pad({"radius_px": 4.0}), ANY, PASS),
    (rules.wrong_size, pad({"radius_px": 0.7 * rules.VIA_RADIUS_PX[0]}), ANY, PASS),
    (rules.wrong_size, pad({"radius_px": less(0.7 * rules.VIA_RADIUS_PX[0])}), ANY, THROW),
    (rules.stroke_end, blob(neck=1.0), ANY, PASS),
    (rules.stroke_end, pad(neck=rules.STROKE_NECK), ANY, THROW),
    (rules.stroke_end, pad(neck=less(rules.STROKE_NECK)), ANY, PASS),
    (rules.stroke_end, pad(neck=1.0, hole=HOLE), ANY, PASS),
    (rules.stroke_end, pad({"visible": rules.WHOLE_SHAPE}, neck=1.0), ANY, THROW),
    (rules.stroke_end, pad({"visible": less(rules.WHOLE_SHAPE)}, neck=1.0), ANY, PASS),
    (rules.stroke_end, pad(neck=rules.WIDEST_TRACE, contrast=rules.DULL_STROKE_SHARE * 150.0), ANY, PASS),
    (rules.stroke_end, pad(neck=rules.WIDEST_TRACE, contrast=less(rules.DULL_STROKE_SHARE * 150.0)), ANY, THROW),
    (rules.stroke_end, pad(neck=less(rules.WIDEST_TRACE), contrast=40.0), ANY, PASS),
    (rules.oval, blob(), ANY, PASS),
    (rules.oval, pad({"ratio": rules.OVAL_RATIO}), ANY, PASS),
    (rules.oval, pad({"ratio": less(rules.OVAL_RATIO)}), ANY, THROW),
    (rules.oval, pad({"ratio": 0.5, "visible": rules.WHOLE_SHAPE}), ANY, THROW),
    (rules.oval, pad({"ratio": 0.5, "visible": less(rules.WHOLE_SHAPE)}), ANY, PASS),
    (rules.cornered, blob(), ANY, PASS),
    (rules.cornered, pad({"squareness": 0.2, "coverage": rules.CLEAR_COVERAGE}), ANY, THROW),
    (rules.cornered, pad({"squareness": 0.2, "coverage": more(rules.CLEAR_COVERAGE)}), ANY, PASS),
    (rules.cornered, pad({"squareness": 0.2, "coverage": 0.8, "visible": rules.WHOLE_SHAPE}), ANY, THROW),
    (rules.cornered, pad({"squareness": 0.2, "coverage": 0.8, "visible": less(rules.WHOLE_SHAPE)}), ANY, PASS),
    (rules.border, pad(touches_border=True), ANY, THROW),
    (rules.border, pad(), ANY, PASS),
    (rules.elongated, blob(length_px=40.0, thickness_px=20.0), ANY, PASS),
    (rules.elongated, blob(length_px=more(40.0), thickness_px=20.0), ANY, THROW),
    (rules.elongated, pad(length_px=80.0), ANY, PASS),
    (rules.angular, blob(boxed=rules.ANGULAR_FILL), ANY, PASS),
    (rules.angular, blob(boxed=more(rules.ANGULAR_FILL)), ANY, THROW),
    (rules.angular, pad(boxed=1.0), ANY, PASS),
    (rules.ragged, blob(circularity=1.6), ANY, PASS),
    (rules.ragged, blob(circularity=more(1.6)), ANY, THROW),
    (rules.ragged, pad(circularity=3.0), ANY, PASS),
]


@pytest.mark.parametrize(("rule", "seen", "wanted", "verdict"), THROWN_BY)
def test_each_rule_throws_beyond_its_limit_and_lets_pass_what_lies_at_it(
    rule: Rule, seen: SeenObject, wanted: Wanted, verdict: Verdict
) -> None:
    assert rule(seen, wanted) is verdict


def test_a_square_is_told_by_corners_larger_than_the_noise_of_its_size() -> None:
    for radius in (5.0, 20.0):
        limit = rules.CORNERED + rules.CORNERED_NOISE_PX / radius
        at, beyond = ({"coverage": 0.8, "radius_px": radius, "squareness": s} for s in (limit, more(limit)))
        assert rules.cornered(pad(at), ANY) is PASS
        assert rules.cornered(pad(beyond), ANY) is THROW
        limit = rules.MOST_SQUARE + rules.SQUARE_NOISE_PX / radius
        at, beyond = ({"radius_px": radius, "squareness": s} for s in (limit, more(limit)))
        assert sound(pad(at), ANY)
        assert not sound(pad(beyond), ANY)


@pytest.mark.parametrize(
    ("wanted", "ranges"),
    [
        (ANY, ((4.5, 8.5), (13.5, 21.5))),
        (Wanted(50.0, 190.0), ((44.0, 56.0),)),
        (Wanted(5.0, 190.0), ((4.0, 6.0),)),
    ],
)
def test_the_wanted_sizes_are_the_two_classes_or_what_cad_says(
    wanted: Wanted, ranges: tuple[tuple[float, float], ...]
) -> None:
    assert wanted.radii_px == ranges
    for low, high in ranges:
        assert wanted.is_sized(low)
        assert wanted.is_sized(high)
        assert not wanted.is_sized(less(low))
        assert not wanted.is_sized(more(high))


@pytest.mark.parametrize(("wanted", "low", "high"), [(ANY, 4.5, 21.5), (Wanted(50.0, 190.0), 44.0, 56.0)])
def test_an_object_without_a_circle_may_hold_a_wanted_one_or_not(wanted: Wanted, low: float, high: float) -> None:
    area = 0.5 * 3.14 * low * low
    for change, verdict in [
        ({"length_px": 2.0 * low - 2.0}, PASS),
        ({"length_px": less(2.0 * low - 2.0)}, THROW),
        ({"area_px": area}, PASS),
        ({"area_px": less(area)}, THROW),
        ({"thickness_px": 2.6 * high}, PASS),
        ({"thickness_px": more(2.6 * high)}, THROW),
    ]:
        just = {"length_px": 200.0, "thickness_px": 30.0, "area_px": 9000.0} | change
        assert rules.other_size(blob(**just), wanted) is verdict
        assert rules.other_size(pad(**just), wanted) is PASS


@pytest.mark.parametrize("rule", [rules.via_with_hole, rules.via_filled, rules.site_with_hole, rules.site_filled])
@pytest.mark.parametrize("radius", [6.5, 17.0])
@pytest.mark.parametrize("hole", [None, HOLE])
def test_each_kind_of_pad_is_taken_by_its_own_rule_and_only_when_sound(
    rule: Rule, radius: float, hole: Hole | None
) -> None:
    own = f"{'via' if radius < 10.0 else 'site'}_{'with_hole' if hole else 'filled'}" == rule.__name__
    assert rule(pad({"radius_px": radius}, hole=hole), ANY) is (TAKE if own else PASS)
    assert rule(pad({"radius_px": radius}, hole=hole, fill=0.1), ANY) is PASS


def test_a_circle_is_a_via_up_to_the_middle_between_the_classes() -> None:
    assert is_via(pad({"radius_px": 11.0}))
    assert not is_via(pad({"radius_px": more(11.0)}))
    assert not is_via(blob())


@pytest.mark.parametrize(
    ("circle", "expected"),
    [
        ({"visible": rules.LEAST_VISIBLE}, True),
        ({"visible": less(rules.LEAST_VISIBLE)}, False),
        ({"coverage": rules.ROUND_COVERAGE}, True),
        ({"coverage": less(rules.ROUND_COVERAGE)}, False),
        ({"visible": rules.WHOLE_VISIBLE, "coverage": rules.ROUND_COVERAGE}, True),
        ({"visible": less(rules.WHOLE_VISIBLE), "coverage": rules.ROUND_COVERAGE}, False),
        ({"visible": less(rules.WHOLE_VISIBLE), "coverage": rules.HIDDEN_COVERAGE}, True),
        ({"visible": less(rules.WHOLE_VISIBLE), "coverage": less(rules.HIDDEN_COVERAGE)}, False),
    ],
)
def test_a_circle_is_one_by_what_is_seen_of_it_and_more_is_asked_of_a_hidden_one(
    circle: dict[str, float], expected: bool
) -> None:
    assert is_round(pad(circle)) is expected
    assert not is_round(blob())


@pytest.mark.parametrize(
    ("at", "beyond"),
    [
        (pad({"ratio": rules.LEAST_RATIO}), pad({"ratio": less(rules.LEAST_RATIO)})),
        (pad({"visible": rules.WHOLE_VISIBLE}), pad({"visible": less(rules.WHOLE_VISIBLE)})),
        (pad({"coverage": rules.CLEAR_COVERAGE}), pad({"coverage": less(rules.CLEAR_COVERAGE)})),
        (pad(neck=less(rules.CLEAR_NECK)), pad(neck=rules.CLEAR_NECK)),
        (pad(fill=rules.LEAST_FILL), pad(fill=less(rules.LEAST_FILL))),
        (pad(), blob()),
    ],
    ids=["ratio", "visible", "coverage", "neck", "fill", "circle"],
)
def test_what_the_others_brightness_is_held_against_is_round_beyond_doubt(at: SeenObject, beyond: SeenObject) -> None:
    assert is_clear(at)
    assert not is_clear(beyond)


DULL, HIDDEN = rules.DULL_SHARE * 190.0, {"visible": less(rules.WHOLE_VISIBLE)}
FAINT = rules.DULL_CONTRAST_SHARE * 150.0
DOUBTFUL = {"coverage": less(rules.CLEAR_COVERAGE)}


@pytest.mark.parametrize(
    ("at", "beyond"),
    [
        (pad(), blob()),
        (pad({"coverage": rules.ROUND_COVERAGE}), pad({"coverage": less(rules.ROUND_COVERAGE)})),
        (pad({"radius_px": 21.5}), pad({"radius_px": more(21.5)})),
        (pad({"radius_px": 13.5, "visible": rules.WHOLE_VISIBLE}), pad({"radius_px": 13.4, "visible": 0.9})),
        (pad({"radius_px": 22.0} | HIDDEN), pad({"radius_px": more(22.0)} | HIDDEN)),
        (pad({"radius_px": 13.0} | HIDDEN), pad({"radius_px": less(13.0)} | HIDDEN)),
        (pad(neck=rules.WIDEST_TRACE), pad(neck=more(rules.WIDEST_TRACE))),
        (pad(neck=0.95, hole=HOLE), pad(neck=0.95)),
        (pad({"ratio": rules.LEAST_RATIO, "coverage": 0.9}), pad({"ratio": less(rules.LEAST_RATIO)})),
        (pad({"ratio": rules.DOUBTFUL_RATIO} | DOUBTFUL), pad({"ratio": less(rules.DOUBTFUL_RATIO)} | DOUBTFUL)),
        (pad({"squareness": 0.2, "visible": less(0.75)}), pad({"squareness": 0.2, "visible": rules.WHOLE_SHAPE})),
        (pad(fill=rules.LEAST_FILL), pad(fill=less(rules.LEAST_FILL))),
        (pad({"noise": less(rules.MOST_NOISE)}), pad({"noise": rules.MOST_NOISE})),
        (pad(level=DULL), pad(level=less(DULL))),
        (pad(contrast=40.0), pad(HIDDEN, contrast=40.0)),
        (pad(HIDDEN, contrast=FAINT), pad(HIDDEN, contrast=less(FAINT))),
        (pad(HIDDEN, level=10.0), pad(level=10.0)),
        (pad({"visible": rules.WHOLE_VISIBLE}, contrast=40.0), pad({"visible": 0.9}, level=10.0)),
    ],
    ids=[
        "circle", "round", "large", "small", "hidden large", "hidden small", "neck", "drilled", "ratio", "doubtful",
        "square", "fill", "noise", "level", "hidden contrast", "contrast", "hidden level", "just whole",
    ],
)  # fmt: skip
def test_a_pad_is_sound_up_to_each_limit(at: SeenObject, beyond: SeenObject) -> None:
    assert sound(at, ANY)
    assert not sound(beyond, ANY)


def test_the_first_rule_that_speaks_decides_and_its_name_stays() -> None:
    def silent(_seen: SeenObject, _wanted: Wanted) -> Verdict:
        return PASS

    assert (decide(PAD, ANY, (silent, rules.site_filled, rules.small)).rule) == "site_filled"
    first = decide(replace(PAD, area_px=1.0), ANY, (silent, rules.small, rules.site_filled))
    assert (first.object.area_px, first.verdict, first.rule) == (1.0, THROW, "small")
    assert decide(PAD, ANY, (silent,)).rule == "no_rule"
