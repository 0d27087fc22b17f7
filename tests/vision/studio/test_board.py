"""The truth of the studio's red-lit boards and control points is what their frames show."""

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from tests.vision.studio import board, board_canvas, board_needle, board_shapes, board_view, mark

SEEDS = range(6)


def middle(
    frame: npt.NDArray[np.uint8], around_px: tuple[float, float], half_px: int, ground: float
) -> tuple[float, float]:
    """Centre of gravity, in the red channel, of what stands out of the ground round a point."""
    x0, y0 = round(around_px[0]) - half_px, round(around_px[1]) - half_px
    patch = frame[y0 : y0 + 2 * half_px + 1, x0 : x0 + 2 * half_px + 1, 2].astype(float) - ground
    y, x = np.mgrid[y0 : y0 + 2 * half_px + 1, x0 : x0 + 2 * half_px + 1]
    return float((patch * x).sum() / patch.sum()), float((patch * y).sum() / patch.sum())


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("radius_px", [5.0, 18.0])
def test_a_disc_seen_squarely_has_its_centre_at_the_truth(seed: int, radius_px: float) -> None:
    scene = board.disc(seed, radius_px=radius_px, noise=0.0)
    assert scene.target_px is not None
    seen = middle(scene.frame, scene.target_px, int(radius_px) + 8, 60.0)
    assert seen == pytest.approx(scene.target_px, abs=0.03)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_tilted_disc_lies_within_a_tenth_of_the_truth_and_where_perspective_puts_it(seed: int) -> None:
    scene = board.disc(seed, noise=0.0, square=False)
    assert scene.target_px is not None
    assert scene.view is not None
    seen = middle(scene.frame, scene.target_px, 26, 60.0)
    ring = scene.view.project(board_shapes.circle(0, 0, 18.0)) - np.array(scene.target_px)
    moments = cv2.moments((ring * 1000).astype(np.float32).reshape(-1, 1, 2))
    bias = np.array([moments["m10"], moments["m01"]]) / moments["m00"] / 1000
    assert np.array(seen) - scene.target_px == pytest.approx(bias, abs=0.03)
    assert np.hypot(*bias) < 0.1


@pytest.mark.parametrize("seed", SEEDS)
def test_a_disc_has_the_area_and_the_height_it_claims(seed: int) -> None:
    scene = board.disc(seed, noise=0.0, contrast=100.0)
    assert scene.target_px is not None
    x, y = (round(v) for v in scene.target_px)
    patch = scene.frame[y - 30 : y + 31, x - 30 : x + 31, 2].astype(float)
    assert (patch - 60).sum() / 100 == pytest.approx(np.pi * scene.radius_px**2, rel=0.01)
    assert patch.max() == 160


def ring_mean(scene: board.RedScene, share: float) -> float:
    """Mean red level on the circle of ``share`` of the target's radius, on the board, round the target."""
    assert scene.view is not None
    assert scene.target_px is not None
    back = board_view.View(np.linalg.inv(scene.view.matrix))
    x, y = back.point(*scene.target_px)
    radius = scene.radius_px / scene.view.semi_major(x, y, 1.0)
    spots = scene.view.project(board_shapes.circle(x, y, share * radius)).astype(np.float32)
    return float(cv2.remap(scene.frame[..., 2], spots[:, :1], spots[:, 1:], cv2.INTER_LINEAR).mean())


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", board.KINDS)
def test_the_target_is_ringed_by_bright_metal_and_a_hole_is_dark(kind: str, seed: int) -> None:
    scene = board.red_scene(seed, kind, noise=0.0)
    rim = ring_mean(scene, 0.7)
    if kind in {"via_hole_centred", "via_filled", "site", "site_hole", "site_mark"}:
        assert ring_mean(scene, 1.5) < 0.6 * rim
    if kind in {"via_hole_centred", "site_hole"}:
        assert ring_mean(scene, 0.05) < 0.9 * rim
    if kind in {"via_filled", "site"}:
        assert ring_mean(scene, 0.05) > 0.8 * rim
    assert rim > 55


def blob_middle(patch: npt.NDArray[np.uint8], *, hole: bool) -> npt.NDArray[np.float64]:
    """Middle (px in the patch) of the bright blob, or of the dark one inside it, at the patch's centre."""
    big = cv2.resize(patch, None, fx=8, fy=8, interpolation=cv2.INTER_CUBIC)
    level = (float(np.percentile(patch, 10)) + float(np.percentile(patch, 98))) / 2
    inside = ((big < level) if hole else (big > level)).astype(np.uint8)
    _, labels, _, middles = cv2.connectedComponentsWithStats(inside)
    label = labels[big.shape[0] // 2, big.shape[1] // 2]
    return (middles[label] + 0.5) / 8 - 0.5


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("kind", ["site", "site_hole", "via_hole_off"])
def test_a_textured_pad_or_its_hole_has_its_middle_at_the_truth(kind: str, seed: int) -> None:
    scene = board.red_scene(seed, kind, noise=0.0, square=True)
    assert scene.target_px is not None
    x, y = (round(v) for v in scene.target_px)
    half = 22 if kind == "site_hole" else round(1.3 * scene.radius_px)
    patch = scene.frame[y - half : y + half + 1, x - half : x + half + 1, 2]
    seen = blob_middle(patch, hole=kind != "site") + np.array([x - half, y - half])
    # One threshold for the whole pad follows its brightness gradient; a hole near the rim is blurred from one side.
    tolerance_px = 0.5 if kind == "via_hole_off" else 0.25
    assert np.hypot(*(seen - scene.target_px)) < tolerance_px


def test_tip_target_and_rivals_keep_their_distances() -> None:
    for kind in board.KINDS:
        for seed in range(4):
            scene = board.red_scene(seed, kind, noise=0.0, square=seed % 2 == 0)
            apart = sorted(np.hypot(x - scene.around_px[0], y - scene.around_px[1]) for x, y, _ in scene.pads)
            assert scene.target_px is not None
            assert np.hypot(*(np.array(scene.target_px) - scene.around_px)) == pytest.approx(apart[0])
            assert apart[0] <= board.REACH_PX
            assert all(far >= apart[0] + board.RUNNER_UP_PX for far in apart[1:])
            classes = ((4.9, 8.2), (13.7, 21.5))
            assert any(low <= scene.radius_px <= high for low, high in classes)


@pytest.mark.parametrize("kind", ["via_hole_centred", "site", "site_hole", "tangent_sites", "row"])
def test_a_needle_hides_the_share_it_says_and_never_the_hole(kind: str) -> None:
    """The share is counted again on the raster: needle times pad, over pad."""
    for seed in range(3):
        scene = board.red_scene(seed, kind, needle=True, square=True)
        assert scene.needle is not None
        assert scene.target_px is not None
        assert 0.02 < scene.hidden_share <= 1 / 3
        assert not scene.needle.covers(np.array(scene.target_px)) or kind in {"site", "tangent_sites", "row"}
        needle, pad = np.zeros((2, *board_view.FRAME_HW))
        outlines = (scene.needle.outline(), board_shapes.circle(*scene.target_px, scene.radius_px))
        for layer, outline in zip((needle, pad), outlines, strict=True):
            share, x0, y0 = board_canvas.coverage(outline, board_view.FRAME_HW)
            layer[y0 : y0 + share.shape[0], x0 : x0 + share.shape[1]] = share
        # The raster's disc is round the hole, which is a little off the pad's middle.
        assert (needle * pad).sum() / pad.sum() == pytest.approx(scene.hidden_share, abs=0.06)


def test_hidden_share_of_a_half_covered_pad_is_a_half() -> None:
    view = board_view.square_view((430.0, 620.0), 0.3)
    edge_on = board_needle.Needle((430.0, 620.0), 90.0, 400.0, 60, 60, 0, (130, 190))
    pad = board.Pad(0.0, 0.0, 16.0)
    probe_width = float(edge_on.half_width(np.array([0.0]))[0])
    assert probe_width == board_needle.BARREL_PX / 2
    assert board.hidden_share(view, pad, edge_on) == pytest.approx(0.5, abs=0.02)


def test_the_same_seed_gives_the_same_scene_and_another_seed_another() -> None:
    one, two, other = (board.red_scene(seed, "site", hard=True) for seed in (3, 3, 4))
    assert np.array_equal(one.frame, two.frame)
    assert one.target_px == two.target_px
    assert one.target_px != other.target_px


@pytest.mark.parametrize("kind", board.EMPTY_KINDS)
def test_an_empty_scene_has_no_target(kind: str) -> None:
    scene = board.red_scene(1, kind)
    assert scene.target_px is None
    assert scene.pads == ()
    assert scene.frame.shape == (1200, 1600, 3)
    assert scene.frame[..., 2].mean() > 4 * scene.frame[..., 0].mean()


def test_an_unknown_kind_is_refused() -> None:
    with pytest.raises(ValueError, match="kind must be one of"):
        board.red_scene(0, "square_peg")


def test_the_raster_keeps_areas_of_solids_and_voids() -> None:
    canvas = board_canvas.Canvas((100.3, 200.7), half_px=30, ground=0.0)
    rings = [board_shapes.circle(100.3, 200.7, 20.0), board_shapes.circle(100.3, 200.7, 8.0)[::-1]]
    canvas.paint(rings, board_canvas.flat(1.0))
    assert canvas.pixels().sum() == pytest.approx(np.pi * (20.0**2 - 8.0**2), rel=0.005)


def test_a_tilted_view_foreshortens_by_the_cosine_and_keeps_the_long_axis() -> None:
    view = board_view.tilted_view((799.5, 599.5), 0.4, np.deg2rad(30.0), 1.1)
    ring = view.project(board_shapes.circle(0, 0, 4.0)).astype(np.float32)
    (_, axes, _) = cv2.fitEllipse(ring)
    assert max(axes) / 2 == pytest.approx(4.0, abs=0.01)
    assert min(axes) / max(axes) == pytest.approx(np.cos(np.deg2rad(30.0)), abs=0.002)


@pytest.mark.parametrize("hidden_arms", [0, 1, 2])
@pytest.mark.parametrize("angle_deg", [None, 0.0, 17.0, 63.0, 210.0])
def test_as_many_arms_are_hidden_as_asked_and_the_rest_are_black_at_the_truth(
    hidden_arms: int, angle_deg: float | None
) -> None:
    scene = mark.mark_scene(5, hidden_arms=hidden_arms, angle_deg=angle_deg)
    assert sum(share > 0.5 for share in scene.arm_hidden) == hidden_arms
    assert np.hypot(*(np.array(scene.around_px) - scene.centre_px)) <= mark.OFFSET_PX
    gray = cv2.GaussianBlur(scene.frame[..., 1], (0, 0), 1.0)
    for index, share in enumerate(scene.arm_hidden):
        if share > 0.02:
            continue
        way, off = np.deg2rad(90 * index), 0.45 * scene.radius_px
        along = off * np.array([np.cos(way), np.sin(way)])
        side = (scene.arm_width_px / 2 + 6) * np.array([-np.sin(way), np.cos(way)])
        on, left, right = scene.view.project(np.array([along, along + side, along - side])).round().astype(int)
        assert int(gray[on[1], on[0]]) < min(int(gray[left[1], left[0]]), int(gray[right[1], right[0]])) - 40


def test_a_control_point_without_a_probe_near_is_symmetric_about_its_centre() -> None:
    """The two edges of each arm, sampled across it, have their middle on the line through the true centre."""
    scene = mark.mark_scene(8, hidden_arms=2)
    gray = scene.frame[..., 1].astype(np.float32)
    for index in (k for k, share in enumerate(scene.arm_hidden) if share < 0.02):
        way = np.deg2rad(90 * index)
        axis, side = np.array([np.cos(way), np.sin(way)]), np.array([-np.sin(way), np.cos(way)])
        across = np.arange(-14.0, 14.01, 0.25)
        middles = []
        for along in np.linspace(0.45, 0.8, 25) * scene.radius_px:
            spots = scene.view.project(along * axis + across[:, None] * side).astype(np.float32)
            dark = cv2.remap(gray, spots[:, :1], spots[:, 1:], cv2.INTER_LINEAR)[:, 0]
            weight = np.clip(np.percentile(dark, 80) - 15 - dark, 0, None)
            middles.append(float((weight * across).sum() / weight.sum()))
        assert np.mean(middles) == pytest.approx(0.0, abs=0.1)


def test_three_hidden_arms_are_refused() -> None:
    with pytest.raises(ValueError, match="hidden_arms must be 0, 1 or 2"):
        mark.mark_scene(0, hidden_arms=3)
