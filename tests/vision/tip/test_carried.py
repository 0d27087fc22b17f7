"""A tip measured a moment ago, before a ground that hides its edges: where its marking shows it, or none."""

from dataclasses import replace

import numpy as np
import pytest

from tests.vision.bright import GROUNDS, bright_frame, placed
from tests.vision.scene import AXIS_DEG, NOMINAL_TIP, Camera, Canvas, Needle, white_frame
from vision import KnownTip, NotFound, ProbeModel, Tip, find_tip

NEAR = Needle()


def known_of(model: ProbeModel, needle: Needle, seed: int = 1) -> KnownTip | None:
    frame = white_frame(needle, Camera(), seed, 0.4)
    tip = find_tip(frame, model)
    return KnownTip.of(frame, tip, model) if isinstance(tip, Tip) else None


def off_px(tip: Tip, needle: Needle) -> tuple[float, float]:
    """How far along the needle and across it."""
    axis = np.radians(needle.angle_deg)
    dx, dy = tip.x_px - needle.tip[0], tip.y_px - needle.tip[1]
    return float(dx * np.cos(axis) + dy * np.sin(axis)), float(dy * np.cos(axis) - dx * np.sin(axis))


def flexed(needle: Needle, rng: np.random.Generator) -> Needle:
    """A stop later: camera and needle flex by some pixels, and hardly turn."""
    x_px, y_px = needle.tip[0] + rng.normal(0.0, 1.5), needle.tip[1] + rng.normal(0.0, 1.5)
    return replace(needle, tip=(x_px, y_px), angle_deg=needle.angle_deg + rng.normal(0.0, 0.05))


@pytest.mark.parametrize("kind", GROUNDS)
def test_before_any_ground_it_is_where_the_marking_shows_it(model: ProbeModel, kind: str) -> None:
    rng, errors, sigmas = np.random.default_rng([3, len(kind)]), [], []
    for seed in range(16):
        before = placed(Needle(), np.random.default_rng([seed, 43]))
        known = known_of(model, before, seed)
        assert known is not None
        now = flexed(before, rng)
        tip = known.carried_to(bright_frame(kind, now, Camera(), 100 + seed))
        if tip is None:
            continue
        assert tip.by_marking
        errors.append(off_px(tip, now))
        sigmas.append((tip.sigma_along_px, tip.sigma_across_px))
    assert len(errors) >= 13
    assert np.abs(errors).max() < 0.6
    assert np.abs(np.array(errors) / np.array(sigmas)).max() < 3.0, "its sigma should be honest"


@pytest.mark.parametrize("stands_deg", [-1.5, -1.0, 0.0, 1.0, 1.5])
@pytest.mark.parametrize("turn_deg", [-0.3, 0.3])
def test_a_small_turn_is_followed_wherever_the_needle_stands(
    model: ProbeModel, stands_deg: float, turn_deg: float
) -> None:
    """The marking is far from the end: a third of a degree there is most of a pixel here."""
    before = replace(NEAR, angle_deg=AXIS_DEG + stands_deg)
    known = known_of(model, before)
    assert known is not None
    now = replace(before, angle_deg=before.angle_deg + turn_deg)
    tip = known.carried_to(bright_frame("grey", now, Camera(), 5))
    assert tip is not None
    assert np.abs(off_px(tip, now)).max() < 0.4
    assert np.degrees(tip.angle_rad - known.tip.angle_rad) == pytest.approx(turn_deg, abs=0.15)


def test_it_is_carried_to_where_no_tip_can_be_measured(model: ProbeModel) -> None:
    """Before a body as grey as the metal, from above the marking on."""
    known, hidden = known_of(model, NEAR), 0
    assert known is not None
    for grey in (100.0, 120.0, 140.0, 160.0):

        def body(canvas: Canvas, grey: float = grey) -> None:
            canvas.paint(canvas.along(NOMINAL_TIP, AXIS_DEG)[0] + 120.0, grey)

        now = replace(NEAR, tip=(NOMINAL_TIP[0] + 1.2, NOMINAL_TIP[1] - 0.7))
        frame = white_frame(now, Camera(), 2, 0.0, more=body)
        hidden += isinstance(find_tip(frame, model), NotFound)
        tip = known.carried_to(frame)
        assert tip is not None
        assert np.abs(off_px(tip, now)).max() < 0.4
    assert hidden >= 1, "the scene should be one where it is needed"


@pytest.mark.parametrize("bend_deg", [-3.0, -1.5, 1.5, 3.0])
@pytest.mark.parametrize("kind", GROUNDS)
def test_a_needle_that_was_bent_in_between_is_none_that_was_measured(
    model: ProbeModel, kind: str, bend_deg: float
) -> None:
    known = known_of(model, NEAR)
    assert known is not None
    assert known.carried_to(bright_frame(kind, replace(NEAR, bend_deg=bend_deg), Camera(), 70)) is None


@pytest.mark.parametrize(
    "other",
    [None, replace(NEAR, angle_deg=AXIS_DEG + 2.0), replace(NEAR, marked=False),
     replace(NEAR, tip=(NOMINAL_TIP[0] + 8.0, NOMINAL_TIP[1] - 4.0)),
     replace(NEAR, rim_width_px=28.0, cylinder_width_px=30.0)],
    ids=["none", "turned", "unmarked", "aside", "thin"],
)  # fmt: skip
def test_what_is_not_as_it_was_is_not_carried(model: ProbeModel, other: Needle | None) -> None:
    known = known_of(model, NEAR)
    assert known is not None
    for kind in GROUNDS:
        assert known.carried_to(bright_frame(kind, other, Camera(), 5)) is None


@pytest.mark.parametrize("pushed_px", [3.0, 8.0, 16.0])
def test_a_push_is_seen_by_it(model: ProbeModel, pushed_px: float) -> None:
    """It should move along with a pin that is pushed in: 3 px are some 70 um."""
    known = known_of(model, NEAR)
    assert known is not None
    axis = np.radians(AXIS_DEG)
    up = NOMINAL_TIP[0] - pushed_px * np.cos(axis), NOMINAL_TIP[1] - pushed_px * np.sin(axis)
    tip = known.carried_to(bright_frame("grey", replace(NEAR, tip=up), Camera(), 5))
    assert tip is not None
    assert np.abs(off_px(tip, replace(NEAR, tip=up))).max() < 0.5


def test_all_that_was_measured_moves_with_it(model: ProbeModel) -> None:
    known = known_of(model, NEAR)
    assert known is not None
    tip = known.carried_to(
        bright_frame("paper", replace(NEAR, tip=(NOMINAL_TIP[0] + 2.0, NOMINAL_TIP[1])), Camera(), 5)
    )
    assert tip is not None
    moved = np.array([tip.x_px - known.tip.x_px, tip.y_px - known.tip.y_px])
    for there, then in ((tip.rim1_px, known.tip.rim1_px), (tip.rim2_px, known.tip.rim2_px),
                        (tip.intersection_px, known.tip.intersection_px)):  # fmt: skip
        assert np.subtract(there, then) == pytest.approx(moved, abs=1e-6)
    assert tip.edges[0].x_px - known.tip.edges[0].x_px == pytest.approx(moved[0], abs=1e-6)
    assert tip.shape == known.tip.shape


def test_a_picture_of_another_size_shows_nothing(model: ProbeModel) -> None:
    known = known_of(model, NEAR)
    assert known is not None
    assert known.carried_to(np.zeros((400, 400, 3), dtype=np.uint8)) is None
    assert known.carried_to(np.zeros((1200, 1600, 3), dtype=np.uint8)) is None
