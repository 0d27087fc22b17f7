"""A map drawn from a known camera is found again, and bad data are refused."""

import math
from pathlib import Path

import numpy as np
import pytest

from vision.frames import HeadModel, Rigid2, rotation
from vision.posemap import PoseMap, Sighting, fit_pose_map

TIP_PX = (428.0, 620.0)
BELOW_PX = (3.8, 7.4)
# An oblique view: 12 um/px across, foreshortened along, with a little perspective.
TRUE = np.array([[11.0, 5.2, 0.0], [-4.9, 12.6, 0.0], [4e-6, 9e-6, 1.0]]) @ np.array(
    [[1, 0, -TIP_PX[0]], [0, 1, -TIP_PX[1]], [0, 0, 1.0]]
)


def _to_px(head_um: np.ndarray) -> tuple[float, float]:
    q = np.linalg.inv(TRUE) @ (*head_um, 1.0)
    return float(q[0] / q[2]), float(q[1] / q[2])


def _sightings(rng: np.random.Generator, n: int = 19, theta_deg: float = 30.0, noise_px: float = 0.0) -> list[Sighting]:
    mark = np.array([1000.0, 2000.0])
    found = []
    for _ in range(n):
        offset = rng.uniform(-700, 700, 2)
        px = (
            np.array(_to_px(rotation(-theta_deg) @ -offset)) + rng.normal(0, noise_px, 2)
            if noise_px
            else _to_px(rotation(-theta_deg) @ -offset)
        )
        found.append(Sighting((float(px[0]), float(px[1])), *(float(v) for v in mark + offset), theta_deg))
    return found


def _fit(sightings: list[Sighting]) -> PoseMap:
    return fit_pose_map(sightings, tip_px=TIP_PX, below_tip_px=BELOW_PX, work_z_um=5200.0)


@pytest.mark.parametrize("theta_deg", [0.0, 77.0, 250.0])
def test_the_map_holds_at_any_head_angle(theta_deg: float) -> None:
    pose_map = _fit(_sightings(np.random.default_rng(1)))
    below = np.add(TIP_PX, BELOW_PX)
    origin = TRUE @ (*below, 1.0)
    target_head = origin[:2] / origin[2] + (250.0, -310.0)
    way = pose_map.correction(_to_px(target_head), TIP_PX, theta_deg)
    assert (way.dx_um, way.dy_um) == pytest.approx(tuple(rotation(theta_deg) @ (250.0, -310.0)), abs=0.01)


def test_noise_of_a_tenth_of_a_pixel_costs_a_few_um() -> None:
    pose_map = _fit(_sightings(np.random.default_rng(2), noise_px=0.1))
    assert pose_map.residual_um < 3.0
    exact = _fit(_sightings(np.random.default_rng(2)))
    places = np.array([(300.0, 0.0), (0.0, -400.0), (-350.0, 350.0)])
    pixels = exact.to_px(places, TIP_PX, 0.0)
    assert np.abs(pose_map.from_tip_um(pixels, TIP_PX, 0.0) - places).max() < 5.0


def test_to_px_is_the_inverse() -> None:
    pose_map = _fit(_sightings(np.random.default_rng(3)))
    places = np.array([(120.0, -333.0), (-600.0, 210.0)])
    assert pose_map.from_tip_um(pose_map.to_px(places, TIP_PX, 200.0), TIP_PX, 200.0) == pytest.approx(places, abs=1e-6)


def test_scale_is_the_larger_one_of_an_oblique_view() -> None:
    pose_map = _fit(_sightings(np.random.default_rng(4)))
    singular = np.linalg.svd(TRUE[:2, :2], compute_uv=False)
    assert 1 / pose_map.scale_px_per_um(TIP_PX) == pytest.approx(singular[1], rel=0.02)


def test_one_outlier_does_not_bend_the_map() -> None:
    sightings = _sightings(np.random.default_rng(5))
    bad = sightings[4]
    sightings[4] = Sighting((bad.target_px[0] + 25.0, bad.target_px[1]), bad.x_um, bad.y_um, bad.theta_deg)
    places = np.array([(300.0, 100.0)])
    pixels = _fit(_sightings(np.random.default_rng(5))).to_px(places, TIP_PX, 0.0)
    assert np.abs(_fit(sightings).from_tip_um(pixels, TIP_PX, 0.0) - places).max() < 20.0


def test_too_few_or_lined_up_or_not_finite_sightings_are_refused() -> None:
    sightings = _sightings(np.random.default_rng(6))
    with pytest.raises(ValueError, match="at least"):
        _fit(sightings[:5])
    line = [Sighting((428.0 + k, 620.0 + 2 * k), 10.0 * k, 20.0 * k, 0.0) for k in range(10)]
    with pytest.raises(ValueError, match="line"):
        _fit(line)
    with pytest.raises(ValueError, match="finite"):
        _fit([*sightings, Sighting((math.nan, 0.0), 0.0, 0.0, 0.0)])


def test_a_map_survives_its_file_and_a_torn_file_is_refused(tmp_path: Path) -> None:
    pose_map = _fit(_sightings(np.random.default_rng(7)))
    path = tmp_path / "map.json"
    path.write_text(pose_map.to_json())
    again = PoseMap.load(path)
    assert np.array_equal(again.homography, pose_map.homography)
    assert again.below_tip_px == pose_map.below_tip_px
    path.write_text(pose_map.to_json()[:100])
    with pytest.raises(ValueError, match="calibrate"):
        PoseMap.load(path)


def test_the_corrected_pose_of_the_thesis() -> None:
    """Eq. 6.12..6.14 with the misprints put right: the error (-1.2322, -0.2322) is (-1.0355, 0.7071) on the head."""
    to_b = Rigid2(45.0, 10.0, 5.0)
    camera = to_b.apply((2.5, 0.0))
    assert camera == pytest.approx((11.7678, 6.7678), abs=1e-4)
    on_head = rotation(-45.0) @ (-1.2322, -0.2322)
    assert on_head == pytest.approx((-1.0355, 0.7071), abs=2e-4)
    assert to_b.apply(np.array((2.5, 0.0)) - on_head) == pytest.approx((13.0, 7.0), abs=1e-3)
    assert to_b.inverse().apply(camera) == pytest.approx((2.5, 0.0))
    assert to_b.then(to_b.inverse()).apply((3.0, 4.0)) == pytest.approx((3.0, 4.0))


def test_the_head_draws_a_circle() -> None:
    head = HeadModel(14938.26, -3.054)
    offsets = np.array([head.tip_offset_um(t) for t in (0.0, 90.0, 180.0)])
    assert np.linalg.norm(offsets, axis=1) == pytest.approx([14938.26] * 3)
    assert offsets[0] == pytest.approx(-offsets[2])
    assert offsets[1] == pytest.approx(rotation(90.0) @ offsets[0])
