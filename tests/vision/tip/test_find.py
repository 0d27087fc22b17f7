from collections.abc import Iterable
from dataclasses import replace

import cv2
import numpy as np
import pytest

from tests.vision.scene import AXIS_DEG, NOMINAL_TIP, Camera, Canvas, Needle, frame_of, side_lit, white_frame
from tests.vision.studio.needle import golden, white_scene
from vision import NotFound, ProbeModel, Reason, Tip, find_tip


def shifted(rng: np.random.Generator) -> Needle:
    tip = NOMINAL_TIP[0] + rng.uniform(-15, 15), NOMINAL_TIP[1] + rng.uniform(-15, 15)
    return Needle(tip=tip, angle_deg=AXIS_DEG + rng.uniform(-3, 3))


def hard_camera(rng: np.random.Generator) -> Camera:
    return Camera(rng.uniform(0.75, 1.25), rng.uniform(0.7, 1.4), 7.0, 0.003, True, 0.1)


def errors(model: ProbeModel, scenes: Iterable[tuple[Needle, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    found = [(needle, find_tip(frame, model)) for needle, frame in scenes]
    tips = [(needle, tip) for needle, tip in found if isinstance(tip, Tip)]
    assert len(tips) >= 0.95 * len(found)
    error = np.array([[tip.x_px - needle.tip[0], tip.y_px - needle.tip[1]] for needle, tip in tips])
    return error, np.array([tip.sigma_px for _, tip in tips])


def test_the_tip_is_found_to_0_15_px_rms_before_a_board(model: ProbeModel) -> None:
    rng = np.random.default_rng(11)
    needles = [shifted(rng) for _ in range(40)]
    scenes = ((needle, white_frame(needle, Camera(), seed, 0.4)) for seed, needle in enumerate(needles))
    error, sigma = errors(model, scenes)
    assert np.sqrt(np.mean(np.sum(error**2, axis=1))) <= 0.15
    assert np.max(np.abs(error)) < 0.5
    assert 0.5 < np.sqrt(np.mean((error / sigma[:, None]) ** 2)) < 2.0, "sigma_px should be honest"


def test_the_tip_is_found_to_0_3_px_rms_with_noise_spikes_blur_gain_glint_and_clutter(model: ProbeModel) -> None:
    rng = np.random.default_rng(12)
    drawn = [(shifted(rng), hard_camera(rng)) for _ in range(50)]
    scenes = ((needle, white_frame(needle, camera, 500 + seed, 1.0)) for seed, (needle, camera) in enumerate(drawn))
    error, _ = errors(model, scenes)
    assert np.sqrt(np.mean(np.sum(error**2, axis=1))) <= 0.3
    assert np.max(np.abs(error)) < 1.5


def test_a_tip_over_a_large_bright_pad_is_found(model: ProbeModel) -> None:
    def pad(canvas: Canvas) -> None:
        canvas.paint(canvas.ellipse(432.0, 628.0, 42.0, 0.87, AXIS_DEG), 190.0)

    for seed in range(6):
        tip = find_tip(white_frame(Needle(), Camera(), seed, 0.3, more=pad), model)
        assert isinstance(tip, Tip)
        assert np.hypot(tip.x_px - NOMINAL_TIP[0], tip.y_px - NOMINAL_TIP[1]) < 0.4


def test_what_was_measured_on_the_way_is_told(model: ProbeModel) -> None:
    tip = find_tip(white_frame(Needle(), Camera(), 3, 0.0), model)
    assert isinstance(tip, Tip)
    assert np.hypot(tip.x_px - tip.rim2_px[0], tip.y_px - tip.rim2_px[1]) == pytest.approx(model.h_px, abs=0.01)
    length = np.hypot(tip.rim2_px[0] - tip.rim1_px[0], tip.rim2_px[1] - tip.rim1_px[1])
    assert length == pytest.approx(45.0, abs=0.7)
    first, second = tip.edges
    assert first.offset_px(*tip.intersection_px) == pytest.approx(0.0, abs=0.3)
    assert second.offset_px(*tip.intersection_px) == pytest.approx(0.0, abs=0.3)
    assert first.x_px > second.x_px, "L1 is the edge met first from the right"
    assert tip.width_px == pytest.approx(42.0, abs=0.7)
    assert tip.marking_contrast > 0.7
    assert tip.score > 0.9
    assert abs(tip.bend_px) < 0.6


def reason_of(result: Tip | NotFound) -> Reason:
    assert isinstance(result, NotFound), result
    assert not result
    assert len(result.message) > 40
    return result.reason


def test_an_empty_scene_has_no_tip(model: ProbeModel) -> None:
    for seed in range(12):
        assert reason_of(find_tip(white_frame(None, Camera(), seed, 1.5), model)) in {
            Reason.NO_NEEDLE,
            Reason.WRONG_NEEDLE,
            Reason.NO_MARKING,
        }


def test_a_needle_without_marking_is_named(model: ProbeModel) -> None:
    result = find_tip(white_frame(Needle(marked=False), Camera(), 1, 0.2), model)
    assert reason_of(result) in {Reason.NO_MARKING, Reason.NO_NEEDLE}


def test_a_marking_worn_shorter_is_refused(model: ProbeModel) -> None:
    worn = find_tip(white_frame(Needle(marking_px=38.0), Camera(), 1, 0.2), model)
    assert reason_of(worn) is Reason.NO_MARKING


def test_a_marking_renewed_elsewhere_is_refused(model: ProbeModel) -> None:
    """It should see by the taper's width that rim 2 no longer is where h was taught."""
    needle = Needle(taper_px=117.0, rim_width_px=4.4 + 35.6 * 117 / 127)
    assert reason_of(find_tip(white_frame(needle, Camera(), 2, 0.0), model)) in {Reason.NO_MARKING, Reason.WRONG_NEEDLE}


@pytest.mark.parametrize("bend_deg", [2.0, -3.0, 6.0])
def test_a_bent_needle_is_named(model: ProbeModel, bend_deg: float) -> None:
    result = find_tip(white_frame(Needle(bend_deg=bend_deg), Camera(), 4, 0.0), model)
    assert reason_of(result) in {Reason.BENT, Reason.WRONG_NEEDLE}


def test_a_slightly_bent_needle_is_never_far_off(model: ProbeModel) -> None:
    for bend_deg in (0.3, 0.6, 0.9, 1.2):
        tip = find_tip(white_frame(Needle(bend_deg=bend_deg), Camera(), 5, 0.2), model)
        assert not tip or np.hypot(tip.x_px - NOMINAL_TIP[0], tip.y_px - NOMINAL_TIP[1]) < 3.0


def test_a_turned_needle_is_named(model: ProbeModel) -> None:
    result = find_tip(white_frame(Needle(angle_deg=AXIS_DEG + 5.5), Camera(), 4, 0.0), model)
    assert reason_of(result) in {Reason.BENT, Reason.WRONG_NEEDLE}


def test_another_needle_is_named(model: ProbeModel) -> None:
    thick = Needle(rim_width_px=56.0, cylinder_width_px=58.0)
    assert reason_of(find_tip(white_frame(thick, Camera(), 4, 0.0), model)) in {Reason.WRONG_NEEDLE, Reason.NO_NEEDLE}


def test_light_and_focus_faults_are_named(model: ProbeModel) -> None:
    frame = white_frame(Needle(), Camera(), 4, 0.2)
    assert reason_of(find_tip((frame // 8).astype(np.uint8), model)) is Reason.TOO_DARK
    assert reason_of(find_tip(np.full_like(frame, 255), model)) is Reason.SATURATED
    assert reason_of(find_tip(cv2.GaussianBlur(frame, (0, 0), 5.0), model)) is Reason.BLURRED


def test_a_smaller_picture_is_out_of_frame(model: ProbeModel) -> None:
    frame = white_frame(Needle(), Camera(), 4, 0.2)
    assert reason_of(find_tip(np.ascontiguousarray(frame[:480, :640]), model)) is Reason.OUT_OF_FRAME
    assert reason_of(find_tip(np.zeros((10, 10, 3), np.uint8), model)) is Reason.OUT_OF_FRAME


def test_a_needle_shoved_far_away_is_not_guessed(model: ProbeModel) -> None:
    for dx, dy in ((60.0, 0.0), (-45.0, 30.0), (0.0, -70.0)):
        needle = replace(Needle(), tip=(NOMINAL_TIP[0] + dx, NOMINAL_TIP[1] + dy))
        tip = find_tip(white_frame(needle, Camera(), 6, 0.2), model)
        assert not tip or np.hypot(tip.x_px - needle.tip[0], tip.y_px - needle.tip[1]) < 3.0


def test_the_input_is_not_changed_and_the_answer_repeats(model: ProbeModel) -> None:
    frame = white_frame(Needle(), Camera(), 8, 0.5)
    before = frame.copy()
    assert find_tip(frame, model) == find_tip(frame, model)
    assert np.array_equal(frame, before)


def test_half_a_needle_at_the_frame_edge_is_no_tip(model: ProbeModel) -> None:
    canvas = Canvas((338, 470), (210, 270), 38.0)
    frame = frame_of(canvas.develop(Camera(), np.random.default_rng(1)), canvas, True, 38.0)
    assert not find_tip(frame, model)


KITS = range(4)
REFUSED = {
    "no_needle": {Reason.NO_NEEDLE, Reason.NO_MARKING},
    "other_needle": {Reason.WRONG_NEEDLE, Reason.NO_NEEDLE, Reason.NO_MARKING, Reason.BENT, Reason.BLURRED},
    "no_marking": {Reason.NO_MARKING, Reason.NO_NEEDLE, Reason.WRONG_NEEDLE},
    "worn_marking": {Reason.NO_MARKING, Reason.NO_NEEDLE},
    "bent": {Reason.BENT, Reason.WRONG_NEEDLE},
    "turned": {Reason.BENT, Reason.NO_NEEDLE},
    "dark": {Reason.TOO_DARK},
    "saturated": {Reason.SATURATED},
    "blurred": {Reason.BLURRED},
}


@pytest.fixture(scope="module")
def studio_models() -> list[ProbeModel]:
    """Four needles of another artist, each taught from its golden picture."""
    taught = [(golden(0, kit=kit)) for kit in KITS]
    return [ProbeModel.teach(scene.frame, scene.tip_px) for scene in taught if scene.tip_px is not None]


@pytest.mark.parametrize(("hard", "limit_px"), [(False, 0.25), (True, 0.45)])
def test_needles_of_another_artist_are_found(studio_models: list[ProbeModel], hard: bool, limit_px: float) -> None:
    """It should find a straight cone, a flat end under a bare cylinder, a crown, and a rounded taper alike."""
    errors_px = []
    for seed in range(12):
        scene = white_scene(300 + seed, hard=hard, kit=seed % 4)
        tip = find_tip(scene.frame, studio_models[seed % 4])
        assert scene.tip_px is not None
        if tip:
            errors_px.append(np.hypot(tip.x_px - scene.tip_px[0], tip.y_px - scene.tip_px[1]))
            assert errors_px[-1] < 6.0 * tip.sigma_px
    assert len(errors_px) >= (10 if hard else 11)
    assert np.sqrt(np.mean(np.square(errors_px))) < limit_px


@pytest.mark.parametrize("defect", REFUSED)
def test_defects_of_another_artist_are_refused_and_named(studio_models: list[ProbeModel], defect: str) -> None:
    for kit in (0, 1):
        scene = white_scene(40 + kit, defect=defect, kit=kit)
        assert reason_of(find_tip(scene.frame, studio_models[kit])) in REFUSED[defect]


def test_a_needle_turned_far_is_named_bent(model: ProbeModel) -> None:
    for turn_deg in (-12.0, 8.0):
        needle = Needle(angle_deg=AXIS_DEG + turn_deg)
        assert reason_of(find_tip(white_frame(needle, Camera(), 3, 0.2), model)) is Reason.BENT


def test_a_thinner_or_thicker_needle_is_named(model: ProbeModel) -> None:
    for scale in (0.7, 1.4):
        needle = Needle(rim_width_px=40.0 * scale, cylinder_width_px=42.0 * scale)
        assert reason_of(find_tip(white_frame(needle, Camera(), 3, 0.2), model)) is Reason.WRONG_NEEDLE


@pytest.fixture(scope="module", params=[(-1, False), (1, False), (-1, True), (1, True)])
def side_lit_needle(request: pytest.FixtureRequest) -> tuple[Needle, ProbeModel]:
    """A needle lit from one side and its model."""
    needle = side_lit(*request.param)
    return needle, ProbeModel.teach(white_frame(needle, Camera(), seed=1, clutter=0.0), NOMINAL_TIP)


def test_a_needle_lit_from_one_side_is_found(side_lit_needle: tuple[Needle, ProbeModel]) -> None:
    needle, model = side_lit_needle
    rng = np.random.default_rng(21)
    placed = [replace(needle, tip=drawn.tip, angle_deg=drawn.angle_deg) for drawn in (shifted(rng) for _ in range(12))]
    cameras = [Camera() if seed % 2 else hard_camera(rng) for seed in range(12)]
    scenes = [(one, white_frame(one, cameras[seed], seed, 0.6)) for seed, one in enumerate(placed)]
    found = [(one, find_tip(frame, model)) for one, frame in scenes]
    error_px = [np.hypot(tip.x_px - one.tip[0], tip.y_px - one.tip[1]) for one, tip in found if tip]
    assert len(error_px) >= 11
    assert max(error_px) < 1.0


@pytest.mark.parametrize("scale", [0.55, 1.7])
def test_another_needle_lit_from_one_side_is_refused(side_lit_needle: tuple[Needle, ProbeModel], scale: float) -> None:
    needle, model = side_lit_needle
    other = replace(
        needle,
        end_width_px=needle.end_width_px * scale,
        rim_width_px=needle.rim_width_px * scale,
        cylinder_width_px=needle.cylinder_width_px * scale,
        flare=needle.flare * scale,
    )
    for seed in range(3):
        assert not find_tip(white_frame(other, Camera(), seed, 0.3), model)


def test_no_picture_makes_it_raise(side_lit_needle: tuple[Needle, ProbeModel], model: ProbeModel) -> None:
    """It should answer Tip or NotFound whatever it sees: other needles, parts of one, noise, stripes, nothing."""
    rng = np.random.default_rng(5)
    stripes = np.tile((np.arange(1600) % 24 < 12) * np.uint8(200), (1200, 1))
    planes = [np.full((1200, 1600), level, np.uint8) for level in (0, 90, 255)]
    planes += [stripes, stripes[:, ::-1], rng.integers(0, 256, (1200, 1600)).astype(np.uint8)]
    frames = [np.repeat(plane[:, :, None], 3, axis=2) for plane in planes]
    for one in (Needle(), side_lit(-1, True), side_lit(1, False), replace(side_lit(1, True), marked=False)):
        frame = white_frame(one, Camera(), 3, 1.0)
        frames += [frame, np.ascontiguousarray(frame[:, ::-1]), np.roll(frame, -40, axis=0)]
    for frame in frames:
        for taught in (side_lit_needle[1], model):
            assert isinstance(find_tip(frame, taught), Tip | NotFound)


def with_glint(
    frame: np.ndarray, needle: Needle, above_tip_px: float, off_axis_px: float, size_px: float
) -> np.ndarray:
    """Add a soft bright blob, longer along the needle, to a white frame."""
    angle = np.radians(needle.angle_deg)
    c, s = np.cos(angle), np.sin(angle)
    rows, columns = np.mgrid[0:800, 0:800]
    dx, dy = columns - needle.tip[0], rows - needle.tip[1]
    u, v = dx * c + dy * s + above_tip_px, dy * c - dx * s - off_axis_px
    blob = 150.0 * np.exp(-0.5 * ((u / (1.8 * size_px)) ** 2 + (v / size_px) ** 2))
    lit = frame.copy()
    lit[:800, :800] = np.clip(lit[:800, :800] + blob[:, :, None], 0, 255).astype(np.uint8)
    return lit


@pytest.mark.parametrize("above_tip_px", [127.0, 138.0, 150.0, 163.0, 172.0])
def test_a_glint_on_the_marking_does_not_hide_it(model: ProbeModel, above_tip_px: float) -> None:
    rng = np.random.default_rng(31)
    for seed in range(6):
        needle = shifted(rng)
        frame = white_frame(needle, Camera(), seed, 0.3)
        lit = with_glint(frame, needle, above_tip_px, rng.uniform(-6, 6), rng.uniform(3, 7))
        tip = find_tip(lit, model)
        assert isinstance(tip, Tip), tip
        assert np.hypot(tip.x_px - needle.tip[0], tip.y_px - needle.tip[1]) < 0.6


def test_a_glint_does_not_make_a_marking(model: ProbeModel) -> None:
    for seed, above_tip_px in enumerate((115.0, 130.0, 150.0, 185.0)):
        for needle in (Needle(marked=False), Needle(marking_px=37.0)):
            lit = with_glint(white_frame(needle, Camera(), seed, 0.2), needle, above_tip_px, 2.0, 5.0)
            assert reason_of(find_tip(lit, model)) in {Reason.NO_MARKING, Reason.NO_NEEDLE}
