from collections.abc import Callable

import numpy as np
import pytest

from tests.vision.scene import AXIS_DEG, NOMINAL_TIP, Camera, Canvas, Needle, Pad, red_frame, white_frame
from vision import NotFound, ProbeModel, Reason, Seen, TestPoint, View, find_test_points, find_tip
from vision.pads.rules import RULES, SeenObject, Verdict, Wanted

Draw = Callable[[np.random.Generator], tuple[Pad, ...]]
AROUND = NOMINAL_TIP
# The board point below the tip lies about 8 px further along the needle.
BELOW = (AROUND[0] + 3.6, AROUND[1] + 7.1)


def near(rng: np.random.Generator, most: float = 20.0) -> tuple[float, float]:
    angle, distance = rng.uniform(0, 2 * np.pi), rng.uniform(0, most)
    return AROUND[0] + distance * np.cos(angle), AROUND[1] + distance * np.sin(angle)


def below(rng: np.random.Generator) -> tuple[float, float]:
    x, y = near(rng, 4.0)
    return x + 3.6, y + 7.1


def level(rng: np.random.Generator) -> float:
    return rng.uniform(140, 230)


def touching(rng: np.random.Generator) -> tuple[Pad, ...]:
    x, y = near(rng, 10.0)
    radius, angle = rng.uniform(14, 20), rng.uniform(0, 2 * np.pi)
    xs, ys = View().to_image(x, y, np.array([2 * radius + 0.3]), np.array([angle]))
    return Pad(x, y, radius), Pad(float(xs[0]), float(ys[0]), radius)


def shift(rng: np.random.Generator, most: float) -> tuple[float, float]:
    return rng.uniform(-most, most), rng.uniform(-most, most)


WHOLE: dict[str, tuple[Draw, float | None, str]] = {
    "via with hole": (
        lambda g: (Pad(*near(g), g.uniform(5, 8), g.uniform(2, 2.6), shift(g, 0.5), level=level(g)),),
        None,
        "via_with_hole",
    ),
    "via without hole": (lambda g: (Pad(*near(g), g.uniform(5, 8), level=level(g)),), None, "via_filled"),
    "via joined to a net": (
        lambda g: (Pad(*near(g), g.uniform(5, 8), trace_deg=g.uniform(0, 360), level=level(g)),),
        None,
        "via_filled",
    ),
    "site with hole": (
        lambda g: (Pad(*near(g), g.uniform(14, 21), g.uniform(3, 6), shift(g, 1.5), level=level(g)),),
        None,
        "site_with_hole",
    ),
    "site without hole": (
        lambda g: (Pad(*near(g), g.uniform(14, 21), ratio=g.uniform(0.83, 0.91), level=level(g)),),
        None,
        "site_filled",
    ),
    "two touching sites": (touching, None, "site_filled"),
    "pad of 1 mm from CAD": (lambda g: (Pad(*near(g), 42.0, level=level(g)),), 42.0, "site_filled"),
}


def errors(draw: Draw, expected: float | None, rule: str, hard: bool, count: int) -> tuple[np.ndarray, np.ndarray]:
    found, sigmas = [], []
    for seed in range(count):
        rng = np.random.default_rng(seed)
        camera = Camera()
        if hard:
            camera = Camera(rng.uniform(0.75, 1.25), rng.uniform(0.7, 1.4), 7.0, 0.003, True, 0.1)
        pads = draw(rng)
        seen = find_test_points(red_frame(pads, None, camera, seed), AROUND, 30, expected)
        assert isinstance(seen.nearest, TestPoint), (seed, seen.nearest)
        assert seen.nearest.rule == rule
        assert seen.nearest.kind == ("via" if pads[0].radius_px < 10 else "site")
        assert seen.nearest.radius_px == pytest.approx(pads[0].radius_px, abs=0.5)
        nearest = min(pads, key=lambda pad: np.hypot(pad.target[0] - AROUND[0], pad.target[1] - AROUND[1]))
        found.append((seen.nearest.x_px - nearest.target[0], seen.nearest.y_px - nearest.target[1]))
        sigmas.append(seen.nearest.sigma_px)
    return np.array(found), np.array(sigmas)


@pytest.mark.parametrize("kind", WHOLE)
def test_every_kind_of_figure_5_17_is_taken_and_centred_to_0_1_px(kind: str) -> None:
    error, sigma = errors(*WHOLE[kind], hard=False, count=15)
    assert np.sqrt(np.mean(np.sum(error**2, axis=1))) <= 0.1
    assert 0.2 < np.sqrt(np.mean((error / sigma[:, None]) ** 2)) < 2.5, "sigma_px should be honest"


@pytest.mark.parametrize("kind", WHOLE)
def test_noise_spikes_blur_gain_and_glint_cost_little(kind: str) -> None:
    error, _ = errors(*WHOLE[kind], hard=True, count=12)
    assert np.sqrt(np.mean(np.sum(error**2, axis=1))) <= 0.2


HIDDEN: dict[str, tuple[Draw, float | None]] = {
    "via": (lambda g: (Pad(*below(g), g.uniform(5, 8), g.choice([0.0, 2.2])),), None),
    "site": (lambda g: (Pad(*near(g, 15.0), g.uniform(14, 21), g.choice([0.0, 4.5])),), None),
    "pad of 1 mm": (lambda g: (Pad(*near(g), 42.0),), 42.0),
}


@pytest.mark.parametrize("kind", HIDDEN)
@pytest.mark.parametrize("noise", [3.0, 7.0])
def test_a_pad_half_hidden_by_the_needle_is_centred_to_0_2_px(model: ProbeModel, kind: str, noise: float) -> None:
    draw, expected = HIDDEN[kind]
    tip = find_tip(white_frame(Needle(), Camera(), 1, 0.0), model)
    found = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        pads = draw(rng)
        frame = red_frame(pads, Needle(), Camera(noise=noise, blur_px=rng.uniform(0.7, 1.4)), seed)
        seen = find_test_points(frame, AROUND, 30, expected, tip or None)
        assert isinstance(seen.nearest, TestPoint), (seed, seen.nearest)
        found.append((seen.nearest.x_px - pads[0].target[0], seen.nearest.y_px - pads[0].target[1]))
    assert np.sqrt(np.mean(np.sum(np.square(found), axis=1))) <= 0.2


def reason_of(seen: Seen) -> Reason:
    assert isinstance(seen.nearest, NotFound), seen.nearest
    assert not seen
    assert len(seen.nearest.message) > 40
    return seen.nearest.reason


def silk(canvas: Canvas, rng: np.random.Generator) -> None:
    for _ in range(5):
        at = near(rng, 60.0)
        canvas.paint(canvas.bar(at, rng.choice([0, 45, 90, 120]), rng.uniform(40, 90), 12), rng.uniform(90, 140))


def test_a_board_without_pads_gives_no_answer() -> None:
    for seed in range(15):
        clutter = silk if seed % 2 else None
        seen = find_test_points(red_frame((), Needle() if seed % 3 else None, Camera(noise=5), seed, clutter), AROUND)
        assert reason_of(seen) in {Reason.NO_TEST_POINT, Reason.UNDECIDED}
        assert seen.taken == ()


def test_silkscreen_and_rectangles_beside_it_do_not_draw_a_wrong_pad(model: ProbeModel) -> None:
    tip = find_tip(white_frame(Needle(), Camera(), 1, 0.0), model)

    def beside(canvas: Canvas, rng: np.random.Generator) -> None:
        canvas.paint(canvas.bar((475, 660), 30, 50, 12), 120.0)
        canvas.paint(canvas.bar((390, 660), AXIS_DEG, 26, 30), 200.0)
        canvas.paint(canvas.bar((470, 585), AXIS_DEG + 90, 50, 20), 190.0)

    for seed in range(10):
        pad = Pad(*below(np.random.default_rng(seed)), 17.0, 4.5)
        seen = find_test_points(red_frame((pad,), Needle(), Camera(), seed, beside), AROUND, 30, None, tip or None)
        assert isinstance(seen.nearest, TestPoint), seen.nearest
        assert np.hypot(seen.nearest.x_px - pad.x, seen.nearest.y_px - pad.y) < 0.3
        assert {item.rule for item in seen.thrown} & {"angular", "elongated", "border", "thin"}


def test_two_pads_at_the_same_distance_are_ambiguous_and_both_taken() -> None:
    pads = Pad(AROUND[0] - 15, AROUND[1], 6.5), Pad(AROUND[0] + 15.5, AROUND[1], 6.5)
    seen = find_test_points(red_frame(pads), AROUND)
    assert reason_of(seen) is Reason.AMBIGUOUS
    assert len(seen.taken) == 2


def test_the_nearest_of_several_pads_is_chosen_and_all_are_told() -> None:
    pads = Pad(AROUND[0] + 4, AROUND[1] + 6, 6.5), Pad(AROUND[0] - 25, AROUND[1] + 8, 7.0), Pad(460, 655, 17.0)
    seen = find_test_points(red_frame(pads), AROUND)
    assert isinstance(seen.nearest, TestPoint)
    assert (seen.nearest.x_px, seen.nearest.y_px) == pytest.approx((pads[0].x, pads[0].y), abs=0.15)
    assert len(seen.taken) == 3
    assert seen.taken[0] is seen.nearest


def test_a_pad_beyond_reach_is_no_answer() -> None:
    seen = find_test_points(red_frame((Pad(AROUND[0] + 34, AROUND[1], 6.5),)), AROUND)
    assert reason_of(seen) is Reason.NO_TEST_POINT
    assert len(seen.taken) == 1


def test_a_size_cad_does_not_expect_is_thrown_by_name() -> None:
    seen = find_test_points(red_frame((Pad(*BELOW, 17.0),)), AROUND, 30, expected_radius_px=21.0)
    assert reason_of(seen) in {Reason.NO_TEST_POINT, Reason.UNDECIDED}
    seen = find_test_points(red_frame((Pad(*BELOW, 17.0), Pad(445, 590, 21.0))), AROUND, 40, expected_radius_px=21.0)
    assert all(abs(point.radius_px - 21.0) < 1.0 for point in seen.taken)
    assert "wrong_size" in {item.rule for item in seen.thrown}


def test_a_round_thing_of_an_odd_size_near_the_tip_is_undecided_never_guessed() -> None:
    seen = find_test_points(red_frame((Pad(*BELOW, 11.0), Pad(455, 640, 6.5))), AROUND)
    assert reason_of(seen) is Reason.UNDECIDED
    assert seen.undecided[0].rule == "no_rule"


def test_a_pad_too_hidden_to_centre_is_not_guessed(model: ProbeModel) -> None:
    tip = find_tip(white_frame(Needle(), Camera(), 1, 0.0), model)
    behind = Pad(AROUND[0] - 16, AROUND[1] - 31, 6.0)
    seen = find_test_points(red_frame((behind,), Needle()), AROUND, 40, None, tip or None)
    assert not any(np.hypot(point.x_px - behind.x, point.y_px - behind.y) < 3 for point in seen.taken) or (
        seen.taken[0].visible >= 0.4
    )


def test_light_faults_and_windows_outside_the_frame_are_named() -> None:
    frame = red_frame((Pad(*BELOW, 17.0),))
    assert reason_of(find_test_points(frame // 16, AROUND)) is Reason.TOO_DARK
    assert reason_of(find_test_points(np.full_like(frame, 255), AROUND)) is Reason.SATURATED
    for outside in ((10.0, 600.0), (428.0, 1195.0), (-50.0, -50.0), (1e7, 5.0)):
        assert reason_of(find_test_points(frame, outside)) is Reason.OUT_OF_FRAME


@pytest.mark.parametrize(
    ("around", "reach", "radius"),
    [
        ((np.nan, 1.0), 30, None),
        ((1.0,), 30, None),
        (AROUND, np.nan, None),
        (AROUND, -4, None),
        (AROUND, 30, np.nan),
        (AROUND, 30, 0.0),
        (AROUND, 30, 1e9),
    ],
)
def test_numbers_that_mean_nothing_are_value_errors(
    around: tuple[float, ...], reach: float, radius: float | None
) -> None:
    with pytest.raises(ValueError, match=r"px"):
        find_test_points(red_frame(()), around, reach, radius)


def test_a_new_rule_decides_without_touching_the_others() -> None:
    def nothing_on_mondays(seen: SeenObject, wanted: Wanted) -> Verdict:
        return Verdict.THROW

    frame = red_frame((Pad(*BELOW, 17.0),))
    seen = find_test_points(frame, AROUND, rules=(nothing_on_mondays, *RULES))
    assert reason_of(seen) is Reason.NO_TEST_POINT
    assert {item.rule for item in seen.thrown} == {"nothing_on_mondays"}


def test_a_silkscreen_ring_round_a_pad_does_not_make_it_a_stroke() -> None:
    def ring(canvas: Canvas, rng: np.random.Generator) -> None:
        canvas.paint(np.abs(canvas.ellipse(*BELOW, 1.5 * 42.0, 0.87, AXIS_DEG)) - 6.0, 115.0)

    seen = find_test_points(red_frame((Pad(*BELOW, 42.0),), None, Camera(), 3, ring), AROUND, 30, 42.0)
    assert isinstance(seen.nearest, TestPoint), seen.nearest
    assert (seen.nearest.x_px, seen.nearest.y_px) == pytest.approx(BELOW, abs=0.1)


def test_the_round_end_of_a_silkscreen_stroke_is_no_via() -> None:
    def stroke(canvas: Canvas, rng: np.random.Generator) -> None:
        canvas.paint(canvas.bar((AROUND[0] + 25, AROUND[1]), 0.0, 50, 12), 125.0)
        canvas.paint(canvas.ellipse(*AROUND, 6.0, 1.0, 0.0), 125.0)

    for seed in range(5):
        assert find_test_points(red_frame((), None, Camera(), seed, stroke), AROUND).taken == ()
