"""Teaching and finding of needles that are no points: round, flat, cupped, crowned and serrated ends."""

from functools import cache

import numpy as np
import pytest

from tests.vision.studio.needle import WhiteScene, golden, white_scene
from tests.vision.studio.needle_kit import HEADS
from vision import NotFound, ProbeModel, Reason, Tip, find_tip
from vision.tip import probe_outline
from vision.tip.strip import ProbeStrip
from vision.tip.width import check_width


@cache
def taught(head: str) -> ProbeModel:
    picture = golden(kit=head)
    assert picture.tip_px is not None
    return ProbeModel.teach(picture.frame, picture.tip_px)


def off_px(tip: Tip, scene: WhiteScene) -> tuple[float, float]:
    """Return how far the found end lies from the true one along the needle and across it."""
    assert scene.tip_px is not None
    x, y = tip.x_px - scene.tip_px[0], tip.y_px - scene.tip_px[1]
    c, s = np.cos(tip.angle_rad), np.sin(tip.angle_rad)
    return float(x * c + y * s), float(y * c - x * s)


@pytest.mark.parametrize("head", HEADS)
def test_every_end_is_taught_where_it_was_clicked_and_found_again_there(head: str) -> None:
    picture, model = golden(kit=head), taught(head)
    assert picture.tip_px is not None
    assert np.hypot(model.tip_px[0] - picture.tip_px[0], model.tip_px[1] - picture.tip_px[1]) < 0.2
    missed = 0
    for seed in range(300, 304):
        scene = white_scene(seed, kit=head)
        tip = find_tip(scene.frame, model)
        if isinstance(tip, NotFound):
            missed += 1
            continue
        along, across = off_px(tip, scene)
        assert abs(along) < 0.3
        assert abs(across) < 0.5
    assert missed <= 1


def test_a_blunt_needle_has_no_place_where_its_edges_meet_but_its_end() -> None:
    tip = find_tip(white_scene(300, kit="round_thick").frame, taught("round_thick"))
    assert isinstance(tip, Tip)
    assert not tip.shape.tapers
    assert tip.intersection_px == pytest.approx((tip.x_px, tip.y_px), abs=0.01)


def test_a_crowns_head_is_within_the_outline_that_hides_what_lies_behind_the_needle() -> None:
    model = taught("long_head")
    outline = probe_outline((0.0, 0.0), 0.0, model.shape, 0.0)
    near_end = np.abs(outline[outline[:, 0] > -1.0, 1])
    assert near_end.min() > 14.0
    assert taught("round_shaft").shape.end_half_px == pytest.approx(12.0, abs=0.7)


def test_a_click_before_the_end_of_a_blunt_needle_is_refused() -> None:
    picture = golden(kit="round_thick")
    assert picture.tip_px is not None
    turn = np.radians(picture.angle_deg)
    before = picture.tip_px[0] - 25.0 * np.cos(turn), picture.tip_px[1] - 25.0 * np.sin(turn)
    with pytest.raises(ValueError, match="does not end at the given point"):
        ProbeModel.teach(picture.frame, before)


@pytest.mark.parametrize(
    ("head", "beside_px"), [("round_thick", 10), ("round_thick", 12), ("round_thick", 14), ("serrated", 10)]
)
def test_a_click_on_the_streak_of_light_of_a_wide_needle_teaches_no_narrow_one(head: str, beside_px: int) -> None:
    picture = golden(kit=head)
    assert picture.tip_px is not None
    turn = np.radians(picture.angle_deg)
    beside = picture.tip_px[0] - beside_px * np.sin(turn), picture.tip_px[1] + beside_px * np.cos(turn)
    with pytest.raises(ValueError, match="the needle is wider than what was taken for it"):
        ProbeModel.teach(picture.frame, beside)


def test_a_probe_that_all_but_fills_its_strip_is_no_streak() -> None:
    """Beside it a few columns of ground are left."""
    pixels = np.full((200, 129), 40.0, np.float32)
    pixels[:, 5:124] = 160.0
    pixels[60:100, 5:124] = 30.0
    strip = ProbeStrip(pixels, 0.0, 0.0, 0.0, u_from_px=0, reach_px=64, edge_level=8.0)
    check_width(strip, 59.0, 60.0, 100.0)
    with pytest.raises(ValueError, match="wider than what was taken for it"):
        check_width(strip, 30.0, 60.0, 100.0)


@pytest.mark.parametrize("defect", ["no_needle", "no_marking", "turned", "other_needle"])
def test_a_blunt_needle_that_is_not_as_taught_gives_no_tip(defect: str) -> None:
    for seed in range(4):
        assert not find_tip(white_scene(500 + seed, kit="round_shaft", defect=defect).frame, taught("round_shaft"))


def test_a_thicker_blunt_needle_is_another_one() -> None:
    answer = find_tip(white_scene(300, kit="serrated").frame, taught("cup_shaft"))
    assert isinstance(answer, NotFound)
    assert answer.reason is Reason.WRONG_NEEDLE


def test_the_scatter_is_told_along_the_needle_and_across_it() -> None:
    """Normalised error of both over several needles; one kind of light and one picture taught each."""
    errors = []
    for head in ("round_shaft", "round_thick", "cup_on_cone", "crown_shaft", "ball_on_cone"):
        for seed in range(310, 316):
            scene = white_scene(seed, kit=head, hard=seed % 2 == 1)
            tip = find_tip(scene.frame, taught(head))
            if not isinstance(tip, Tip):
                continue
            along, across = off_px(tip, scene)
            errors.append((along / tip.sigma_along_px, across / tip.sigma_across_px))
            c, s = np.cos(tip.angle_rad), np.sin(tip.angle_rad)
            across_of = np.array([-s, c]) @ tip.covariance_px2 @ np.array([-s, c])
            assert across_of == pytest.approx(tip.sigma_across_px**2)
            assert tip.sigma_px**2 == pytest.approx((tip.sigma_along_px**2 + tip.sigma_across_px**2) / 2.0)
    assert len(errors) >= 25
    along_rms, across_rms = np.sqrt(np.mean(np.square(errors), axis=0))
    assert 0.2 < along_rms < 1.25
    assert 0.8 < across_rms < 1.25


@pytest.mark.parametrize("head", [*HEADS, 0, 1, 2, 3])
def test_a_click_a_little_before_the_end_is_refused_too(head: str | int) -> None:
    """Every landing would inherit it."""
    with pytest.raises(ValueError, match="does not end at the given point"):
        taught_off(head, -10.0)


@pytest.mark.parametrize("head", ["round_thick", "cup_on_cone", "crown_turned", "long_head", 0, 2])
@pytest.mark.parametrize("off_px", [-2.5, 2.5])
def test_a_hand_that_is_off_by_a_little_teaches(head: str | int, off_px: float) -> None:
    assert taught_off(head, off_px)


def taught_off(head: str | int, along_px: float, across_px: float = 0.0) -> ProbeModel:
    """Teach a head by a click that is off along the needle and across it."""
    picture = golden(kit=head)
    assert picture.tip_px is not None
    c, s = np.cos(np.radians(picture.angle_deg)), np.sin(np.radians(picture.angle_deg))
    x, y = picture.tip_px
    return ProbeModel.teach(picture.frame, (x + along_px * c - across_px * s, y + along_px * s + across_px * c))


def test_what_cannot_be_taught_is_said_by_its_shape_and_the_ground_only_where_it_is_to_blame() -> None:
    """On a dark, quiet ground "use a dark, quiet background" is nothing that anybody can do."""
    with pytest.raises(
        ValueError, match=r"a dark band 4[0-9] px long is seen 1[12][0-9] px before .* in the middle"
    ) as off:
        taught_off("round_shaft", 0.0, 20.0)
    with pytest.raises(
        ValueError, match=r"no black marking is seen before .* 16 to 100 px wide .* marking is fresh"
    ) as far:
        taught_off("round_shaft", 0.0, 60.0)
    for said in (off, far):
        assert "background" not in str(said.value)
    bright = white_scene(500, kit="round_shaft", ground="paper", defect="no_needle")
    with pytest.raises(ValueError, match="use a dark, quiet background"):
        ProbeModel.teach(bright.frame, taught("round_shaft").tip_px)


def test_a_needle_that_seems_thinner_below_its_marking_is_not_said_to_narrow_by_nothing() -> None:
    """After a click beside its axis "narrows by 0.00 (0.02 to 1 can be taught, or 0)" was said."""
    picture = golden(kit="round_shaft")
    assert picture.tip_px is not None
    x, y = picture.tip_px
    with pytest.raises(ValueError, match=r"thinner each side below its marking .* in the middle of its width") as said:
        ProbeModel.teach(picture.frame, (x - 8.0, y))
    assert "or 0" not in str(said.value)
