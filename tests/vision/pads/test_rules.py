import json
from dataclasses import replace

import numpy as np
import pytest

from vision.core.circle_fit import CircleFit, Contour
from vision.pads.rule_name import RuleName
from vision.pads.rules import NAMES, RULES, Hole, SeenObject, Verdict, Wanted, decide

CIRCLE = CircleFit(
    50.0, 50.0, 17.0, 0.87, 1.0, 0.03, 1.0, 0.95, 0.01, 0.05, np.ones(48, bool), Contour(50.0, 50.0, 17.0)
)
PAD = SeenObject(
    50.0, 50.0, 900.0, 34.0, 34.0, 1.0, 0.785, 1.0, 190.0, 150.0, 0.0, False, 0.0, False, False, CIRCLE, None, 5.0
)
BLOB = replace(PAD, circle=None)
ANY = Wanted(None, 190.0)


def sized(radius: float, **change: object) -> SeenObject:
    return replace(PAD, circle=replace(CIRCLE, radius_px=radius), **change)


@pytest.mark.parametrize(
    ("seen", "wanted", "verdict", "rule"),
    [
        (PAD, ANY, Verdict.TAKE, "site_filled"),
        (replace(PAD, hole=Hole(50, 50, 5, 0.05)), ANY, Verdict.TAKE, "site_with_hole"),
        (sized(6.5), ANY, Verdict.TAKE, "via_filled"),
        (sized(6.5, hole=Hole(50, 50, 2, 0.05)), ANY, Verdict.TAKE, "via_with_hole"),
        (sized(42.0), Wanted(42.0, 190.0), Verdict.TAKE, "site_filled"),
        (sized(42.0), ANY, Verdict.PASS, "no_rule"),
        (sized(17.0), Wanted(42.0, 190.0), Verdict.THROW, "wrong_size"),
        (sized(11.0), ANY, Verdict.PASS, "no_rule"),
        (replace(BLOB, area_px=12.0), ANY, Verdict.THROW, "small"),
        (replace(PAD, contrast=12.0), ANY, Verdict.THROW, "faint"),
        (replace(BLOB, length_px=30.0, thickness_px=1.5), ANY, Verdict.THROW, "thin"),
        (replace(BLOB, length_px=60.0, thickness_px=10.0), ANY, Verdict.THROW, "thin"),
        (replace(BLOB, length_px=40.0, thickness_px=15.0), ANY, Verdict.THROW, "elongated"),
        (replace(BLOB, touches_border=True), ANY, Verdict.THROW, "border"),
        (replace(BLOB, boxed=0.97), ANY, Verdict.THROW, "angular"),
        (replace(BLOB, circularity=2.0), ANY, Verdict.THROW, "ragged"),
        (BLOB, ANY, Verdict.PASS, "no_rule"),
        (replace(PAD, circle=replace(CIRCLE, coverage=0.5)), ANY, Verdict.PASS, "no_rule"),
        (replace(PAD, circle=replace(CIRCLE, visible=0.3)), ANY, Verdict.PASS, "no_rule"),
        (replace(PAD, fill=0.5), ANY, Verdict.PASS, "no_rule"),
        (replace(PAD, level=90.0), ANY, Verdict.PASS, "no_rule"),
        (replace(PAD, neck=0.75), ANY, Verdict.PASS, "no_rule"),
        (replace(BLOB, in_needle=0.9), ANY, Verdict.THROW, "needle"),
        (replace(PAD, circle=replace(CIRCLE, ratio=0.66)), ANY, Verdict.THROW, "oval"),
        (replace(PAD, circle=replace(CIRCLE, ratio=0.66, visible=0.6)), ANY, Verdict.PASS, "no_rule"),
        (replace(PAD, circle=replace(CIRCLE, ratio=0.73)), ANY, Verdict.PASS, "no_rule"),
        (replace(PAD, circle=replace(CIRCLE, squareness=0.055)), ANY, Verdict.PASS, "no_rule"),
        (replace(PAD, circle=replace(CIRCLE, squareness=0.08)), ANY, Verdict.PASS, "no_rule"),
        (replace(PAD, circle=replace(CIRCLE, squareness=0.08, coverage=0.8)), ANY, Verdict.THROW, "cornered"),
        (replace(PAD, circle=replace(CIRCLE, ratio=0.77, coverage=0.8)), ANY, Verdict.PASS, "no_rule"),
        (replace(PAD, circle=replace(CIRCLE, noise=0.4)), ANY, Verdict.PASS, "no_rule"),
    ],
)
def test_each_object_is_decided_by_its_rule(seen: SeenObject, wanted: Wanted, verdict: Verdict, rule: str) -> None:
    decided = decide(seen, wanted)
    assert (decided.verdict, decided.rule) == (verdict, rule)


def test_every_rule_can_decide_something() -> None:
    """It should leave no rule that never speaks."""
    names = {rule.__name__ for rule in RULES}
    assert {"small", "faint", "thin", "wrong_size", "border", "elongated", "angular", "other_size", "ragged"} <= names
    tiny = replace(BLOB, length_px=6.0, thickness_px=6.0, area_px=30.0)
    assert decide(tiny, Wanted(42.0, 190.0)).rule == "other_size"


def test_the_names_of_the_rules_stay_as_records_and_the_wire_have_them() -> None:
    assert {name.value for name in RuleName} == {
        *("small", "faint", "thin", "border", "needle", "wrong_size", "stroke_end", "oval", "cornered"),
        *("via_with_hole", "via_filled", "site_with_hole", "site_filled"),
        *("elongated", "angular", "other_size", "ragged", "no_rule"),
        *("drawn_ring", "drawn_dot", "overlapping", "overlapped", "trace_of_pad", "at_known_place"),
    }
    assert json.dumps(decide(PAD, ANY).rule) == '"site_filled"'


def test_a_rule_is_named_as_its_function_so_that_its_docstring_is_found_by_the_name() -> None:
    assert [name.value for name in NAMES.values()] == [rule.__name__ for rule in RULES]
