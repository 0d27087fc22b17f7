"""The needle before grounds brighter than its metal: the model is taught before a dark one, as always."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.vision.bright import GROUNDS, bright_frame, placed
from tests.vision.scene import AXIS_DEG, NOMINAL_TIP, Camera, Canvas, Needle, white_frame
from tests.vision.studio.needle import golden, white_scene
from tests.vision.studio.needle_kit import KITS
from vision import NotFound, ProbeModel, Reason, Tip, find_tip

WHOLE = ("paper", "print")
# Farther off than this a tip is wrong: the needle would land elsewhere.
WRONG_PX = 3.0


def off_px(tip: Tip, truth_px: tuple[float, float]) -> float:
    return float(np.hypot(tip.x_px - truth_px[0], tip.y_px - truth_px[1]))


def rms_px(errors_px: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(errors_px))))


def hard_camera(rng: np.random.Generator) -> Camera:
    return Camera(rng.uniform(0.75, 1.1), rng.uniform(0.7, 1.4), 7.0, 0.003, False, 0.1)


@pytest.mark.parametrize("kind", WHOLE)
def test_the_tip_is_found_to_0_2_px_rms_before_paper(model: ProbeModel, kind: str) -> None:
    errors_px = []
    for seed in range(16):
        needle = placed(Needle(), np.random.default_rng([seed, 40]))
        tip = find_tip(bright_frame(kind, needle, Camera(), seed), model)
        if tip:
            errors_px.append(off_px(tip, needle.tip))
    # A shadow that makes the paper as grey as the metal on both sides of the needle may hide one of them.
    assert len(errors_px) >= 15
    assert rms_px(errors_px) < 0.2
    assert max(errors_px) < 0.6


@pytest.mark.parametrize("kind", [*WHOLE, "half"])
def test_noise_spikes_blur_and_gain_cost_little_before_paper(model: ProbeModel, kind: str) -> None:
    errors_px = []
    for seed in range(10):
        rng = np.random.default_rng([seed, 41])
        needle = placed(Needle(), rng)
        tip = find_tip(bright_frame(kind, needle, hard_camera(rng), 50 + seed), model)
        if tip:
            errors_px.append(off_px(tip, needle.tip))
    assert len(errors_px) >= 8
    assert rms_px(errors_px) < 0.3
    assert max(errors_px) < 1.0


def test_the_tip_is_found_where_the_paper_ends_behind_the_needle(model: ProbeModel) -> None:
    errors_px = []
    for seed in range(16):
        needle = placed(Needle(), np.random.default_rng([seed, 42]))
        tip = find_tip(bright_frame("half", needle, Camera(), seed), model)
        if tip:
            errors_px.append(off_px(tip, needle.tip))
    assert len(errors_px) >= 15
    assert rms_px(errors_px) < 0.25
    assert max(errors_px) < 0.8


def test_a_ground_bright_on_one_side_only_does_not_draw_the_tip_aside(model: ProbeModel) -> None:
    """It should know that an edge before something brighter is seen elsewhere than one before something darker."""
    axis = np.radians(AXIS_DEG)
    asides_px = []
    for side in (-1.0, 1.0):

        def half(canvas: Canvas, side: float = side) -> None:
            canvas.paint(-side * canvas.along(NOMINAL_TIP, AXIS_DEG)[1], 200.0)

        found = [find_tip(white_frame(Needle(), Camera(), seed, 0.0, more=half), model) for seed in range(4)]
        for tip in found:
            assert isinstance(tip, Tip), tip
            dx, dy = tip.x_px - NOMINAL_TIP[0], tip.y_px - NOMINAL_TIP[1]
            asides_px.append(side * float(dy * np.cos(axis) - dx * np.sin(axis)))
    assert abs(float(np.mean(asides_px))) < 0.15
    assert float(np.max(np.abs(asides_px))) < 0.4


def test_whatever_the_grounds_level_no_tip_is_wrong(model: ProbeModel) -> None:
    """It should find the needle before dark and bright grounds, and where they are alike be right or refuse."""
    found = {}
    for level in range(20, 221, 20):

        def ground(canvas: Canvas, level: float = float(level)) -> None:
            canvas.level[:] = level

        tip = find_tip(white_frame(Needle(), Camera(), level, 0.0, more=ground), model)
        found[level] = bool(tip)
        assert not tip or off_px(tip, NOMINAL_TIP) < 0.6, (level, tip)
    assert all(found[level] for level in (20, 40, 60, 80, 180, 200, 220))


def test_a_grey_ground_as_bright_as_metal_gives_a_right_tip_or_none(model: ProbeModel) -> None:
    errors_px = []
    for seed in range(12):
        needle = placed(Needle(), np.random.default_rng([seed, 43]))
        tip = find_tip(bright_frame("grey", needle, Camera(), seed), model)
        if tip:
            errors_px.append(off_px(tip, needle.tip))
    assert len(errors_px) >= 6
    assert max(errors_px) < 1.0


@pytest.fixture(scope="module")
def studio_models() -> list[ProbeModel]:
    taught = [golden(0, kit=kit) for kit in range(len(KITS))]
    return [ProbeModel.teach(scene.frame, scene.tip_px) for scene in taught if scene.tip_px is not None]


@pytest.mark.parametrize("kind", [*WHOLE, "half"])
def test_needles_of_another_artist_are_found_before_bright_grounds(studio_models: list[ProbeModel], kind: str) -> None:
    """It should find them to 0.2 px rms, or say that the paper is overexposed."""
    errors_px, missed = [], 0
    for seed in range(12):
        scene = white_scene(800 + seed, kit=seed % 4, ground=kind)
        assert scene.tip_px is not None
        tip = find_tip(scene.frame, studio_models[seed % 4])
        if tip:
            errors_px.append(off_px(tip, scene.tip_px))
        else:
            missed += tip.reason is not Reason.SATURATED
    assert missed <= 1
    assert len(errors_px) >= 9
    assert rms_px(errors_px) < 0.2
    assert max(errors_px) < 0.6


DAMAGED = {
    "unmarked": replace(Needle(), marked=False),
    "worn": replace(Needle(), marking_px=36.0),
    "bent": replace(Needle(), bend_deg=3.0),
    "bent the other way": replace(Needle(), bend_deg=-3.0),
    "turned": replace(Needle(), angle_deg=AXIS_DEG + 7.0),
    "thick": replace(Needle(), rim_width_px=56.0, cylinder_width_px=58.0),
    "thin": replace(Needle(), rim_width_px=28.0, cylinder_width_px=30.0),
    "marked too low": replace(Needle(), taper_px=117.0, rim_width_px=4.4 + 35.6 * 117 / 127),
    "marked too high": replace(Needle(), taper_px=137.0, rim_width_px=4.4 + 35.6 * 137 / 127),
    "short": replace(Needle(), taper_px=110.0),
}


@pytest.mark.parametrize("damage", DAMAGED)
@pytest.mark.parametrize("kind", GROUNDS)
def test_a_damaged_or_other_needle_is_refused_before_bright_grounds(model: ProbeModel, damage: str, kind: str) -> None:
    result = find_tip(bright_frame(kind, DAMAGED[damage], Camera(), 70 + sorted(DAMAGED).index(damage)), model)
    assert isinstance(result, NotFound), result
    assert len(result.message) > 40


@pytest.mark.parametrize("kind", GROUNDS)
def test_a_blurred_needle_is_named_before_bright_grounds(model: ProbeModel, kind: str) -> None:
    result = find_tip(bright_frame(kind, Needle(), Camera(blur_px=5.0), 3), model)
    assert isinstance(result, NotFound)
    assert result.reason is Reason.BLURRED


@pytest.mark.parametrize("kind", GROUNDS)
def test_bright_paper_without_a_needle_has_no_tip(model: ProbeModel, kind: str) -> None:
    for seed in range(3):
        result = find_tip(bright_frame(kind, None, Camera(), seed), model)
        assert isinstance(result, NotFound)
        assert result.reason in {Reason.NO_NEEDLE, Reason.NO_MARKING, Reason.WRONG_NEEDLE}


@pytest.mark.parametrize("defect", ["no_needle", "other_needle", "no_marking", "worn_marking", "bent", "turned"])
def test_defects_of_another_artist_are_refused_before_bright_grounds(
    studio_models: list[ProbeModel], defect: str
) -> None:
    for seed, kind in enumerate(GROUNDS):
        scene = white_scene(40 + seed, defect=defect, kit=seed % 4, ground=kind)
        assert not find_tip(scene.frame, studio_models[seed % 4])


def test_dirt_on_the_marking_before_paper_is_refused_or_right(model: ProbeModel) -> None:
    """It should not take a bright flake on the marking for the rim the end is measured from."""
    axis = np.radians(AXIS_DEG)
    for above_px in (120.0, 130.0, 150.0, 168.0):
        at = NOMINAL_TIP[0] - above_px * np.cos(axis), NOMINAL_TIP[1] - above_px * np.sin(axis)
        frame = bright_frame("paper", Needle(), Camera(), 5)
        rows, columns = np.mgrid[0:800, 0:800]
        flake = np.hypot(columns - at[0], rows - at[1]) < 9.0
        frame[:800, :800][flake] = 205
        tip = find_tip(frame, model)
        assert not tip or off_px(tip, NOMINAL_TIP) < WRONG_PX


def test_an_unknown_ground_is_refused() -> None:
    with pytest.raises(ValueError, match="paper"):
        bright_frame("snow", Needle())
    with pytest.raises(ValueError, match="paper"):
        white_scene(0, ground="snow")
