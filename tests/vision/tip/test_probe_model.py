from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.vision.scene import AXIS_DEG, NOMINAL_TIP, Camera, Needle, side_lit, white_frame
from tests.vision.studio.needle import golden
from vision import ProbeModel, Tip, find_tip


def test_teaching_measures_the_needle(model: ProbeModel) -> None:
    assert model.tip_px == pytest.approx(NOMINAL_TIP, abs=0.25)
    assert np.degrees(model.angle_rad) == pytest.approx(AXIS_DEG, abs=0.05)
    assert model.h_px == pytest.approx(127.0, abs=0.5)
    assert model.shape.marking_px == pytest.approx(45.0, abs=0.7)
    assert 2 * model.shape.cylinder_half_px == pytest.approx(42.0, abs=0.7)
    assert model.template.shape == (220, 116)
    assert model.marking_contrast > 0.7


@pytest.mark.parametrize("bulge", [0.0, 17.0])
def test_a_click_beside_the_axis_is_put_onto_it(bulge: float) -> None:
    frame = white_frame(Needle(bulge_px=bulge), Camera(), seed=2, clutter=0.0)
    taught = ProbeModel.teach(frame, (429.0, 619.5))
    assert taught.tip_px == pytest.approx(NOMINAL_TIP, abs=0.35)
    assert abs(taught.click_offset_px) == pytest.approx(1.1, abs=0.3)


@pytest.mark.parametrize(
    ("needle", "click"),
    [
        (None, NOMINAL_TIP),
        (Needle(marked=False), NOMINAL_TIP),
        (Needle(), (500.0, 500.0)),
        (Needle(), (434.0, 617.0)),
        (Needle(), (-5.0, 10.0)),
        (Needle(), (float("nan"), 620.0)),
    ],
)
def test_what_cannot_be_taught_is_refused_with_a_reason(needle: Needle | None, click: tuple[float, float]) -> None:
    frame = white_frame(needle, Camera(), seed=1, clutter=0.0)
    with pytest.raises(ValueError, match=r"\w{3}"):
        ProbeModel.teach(frame, click)


def test_a_busy_background_is_refused_or_taught_rightly() -> None:
    """It should never store a wrong needle."""
    for seed in range(12):
        frame = white_frame(Needle(), Camera(), seed=seed, clutter=1.5)
        try:
            taught = ProbeModel.teach(frame, NOMINAL_TIP)
        except ValueError:
            continue
        assert np.hypot(*np.subtract(taught.tip_px, NOMINAL_TIP)) < 1.0
        assert 2 * taught.shape.cylinder_half_px == pytest.approx(42.0, abs=2.0)


def test_a_saved_model_comes_back_and_finds_the_same_tip(model: ProbeModel, tmp_path: Path) -> None:
    path = tmp_path / "probe.model"
    model.save(path)
    again = ProbeModel.load(path)
    frame = white_frame(Needle(tip=(431.2, 616.7)), Camera(), seed=9, clutter=0.3)
    assert find_tip(frame, again) == find_tip(frame, model)
    assert again.search_roi_px == model.search_roi_px


@pytest.mark.parametrize("content", [b"", b"not a model", b"PK\x03\x04 torn", b"\x93NUMPY\x01\x00"])
def test_a_file_that_is_no_model_is_a_value_error(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "bad.npz"
    path.write_bytes(content)
    with pytest.raises(ValueError, match="not a probe model"):
        ProbeModel.load(path)


def test_a_damaged_or_later_model_is_a_value_error(model: ProbeModel, tmp_path: Path) -> None:
    path = tmp_path / "model.npz"
    model.save(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match="not a probe model"):
        ProbeModel.load(path)
    for change in ({"facts": np.array('{"version": 99}')}, {"template": np.zeros((3, 3))}):
        with np.load(_written(path, whole)) as stored:
            parts = {**{name: stored[name] for name in stored.files}, **change}
        np.savez(path, **parts)
        with pytest.raises(ValueError, match="not a probe model"):
            ProbeModel.load(path)


def _written(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def test_the_outline_is_measured_not_assumed() -> None:
    """It should teach a rounded taper and one that begins below a bare cylinder as they are."""
    straight, late, rounded = (golden(0, kit=kit) for kit in (0, 1, 3))
    for scene, half_way_px in ((straight, 12.4), (late, 15.6), (rounded, 15.6)):
        assert scene.tip_px is not None
        taught = ProbeModel.teach(scene.frame, scene.tip_px)
        outline = taught.outline
        assert taught.tip_px == pytest.approx(scene.tip_px, abs=0.2)
        assert np.degrees(taught.angle_rad) == pytest.approx(scene.angle_deg, abs=0.1)
        assert np.all(np.diff(outline.half_px[outline.on_taper]) < 0.4), "a needle narrows towards its end"
        half = float(np.interp(-0.55 * taught.h_px, outline.u_px, outline.half_px))
        assert half == pytest.approx(half_way_px, abs=1.0)


@pytest.mark.parametrize("dim_side", [-1, 1])
@pytest.mark.parametrize("tapered", [False, True])
def test_the_end_of_the_light_is_not_taken_for_the_edge(dim_side: int, tapered: bool, tmp_path: Path) -> None:
    """It should see the dim flank of a needle lit from one side, a long taper's too, and keep which side is dim."""
    needle = side_lit(dim_side, tapered)
    taught = ProbeModel.teach(white_frame(needle, Camera(), seed=1, clutter=0.0), NOMINAL_TIP)
    assert taught.tip_px == pytest.approx(NOMINAL_TIP, abs=0.5)
    assert np.degrees(taught.angle_rad) == pytest.approx(AXIS_DEG, abs=0.2)
    outline = taught.outline
    true_half = needle.cylinder_width_px / 2 + needle.flare * (-outline.u_px - needle.taper_px)
    assert outline.half_px[~outline.on_taper] == pytest.approx(true_half[~outline.on_taper], abs=1.0)
    taught.save(tmp_path / "model.npz")
    again = ProbeModel.load(tmp_path / "model.npz")
    assert again.outline.dim_side == outline.dim_side == dim_side
    frame = white_frame(replace(needle, tip=(432.0, 617.0)), Camera(), seed=2, clutter=0.4)
    assert isinstance(find_tip(frame, again), Tip)
    assert find_tip(frame, again) == find_tip(frame, taught)


def test_an_evenly_lit_needle_has_no_dim_side(model: ProbeModel) -> None:
    assert model.outline.dim_side == 0
    assert model.outline.shade_px is None


def test_a_click_where_no_needle_ends_is_refused() -> None:
    frame = white_frame(Needle(), Camera(), seed=3, clutter=0.0)
    axis = np.radians(AXIS_DEG)
    above = NOMINAL_TIP[0] - 40.0 * np.cos(axis), NOMINAL_TIP[1] - 40.0 * np.sin(axis)
    with pytest.raises(ValueError, match="does not end"):
        ProbeModel.teach(frame, above)
