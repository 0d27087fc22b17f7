import numpy as np
import pytest

from vision.core.segment import components, multi_otsu, otsu


def test_otsu_parts_two_populations_between_them() -> None:
    rng = np.random.default_rng(1)
    values = np.concatenate([rng.normal(50, 6, 9000), rng.normal(180, 10, 400)])
    picture = np.clip(values, 0, 255).astype(np.uint8).reshape(94, 100)
    assert 65 < otsu(picture) < 150


def test_multi_class_otsu_parts_four_populations() -> None:
    rng = np.random.default_rng(2)
    levels, sizes = (30, 80, 140, 220), (6000, 2000, 1000, 1000)
    values = np.concatenate([rng.normal(level, 5, size) for level, size in zip(levels, sizes, strict=True)])
    picture = np.clip(values, 0, 255).astype(np.uint8).reshape(100, 100)
    cuts = multi_otsu(picture, 4)
    assert [low < cut < high for low, cut, high in zip(levels, cuts, levels[1:], strict=False)] == [True] * 3


def test_multi_class_otsu_is_the_optimum_that_brute_force_finds() -> None:
    rng = np.random.default_rng(5)
    picture = (rng.integers(0, 16, (40, 40)) * 16).astype(np.uint8)
    values = picture.ravel() // 2

    def between(cuts: tuple[int, ...]) -> float:
        which = np.digitize(picture.ravel(), [cut + 1 for cut in cuts])
        return sum(values[which == k].sum() ** 2 / max((which == k).sum(), 1) for k in range(3))

    best = max(between((low, high)) for low in range(0, 240, 16) for high in range(low + 16, 256, 16))
    assert between(multi_otsu(picture, 3)) == pytest.approx(best)


def test_a_flat_picture_has_thresholds_and_one_class_is_refused() -> None:
    assert len(multi_otsu(np.full((8, 8), 77, np.uint8), 4)) == 3
    with pytest.raises(ValueError, match="classes"):
        multi_otsu(np.zeros((4, 4), np.uint8), 1)


def test_components_come_largest_first_with_their_boxes() -> None:
    mask = np.zeros((20, 30), np.uint8)
    mask[2:5, 3:6] = 1
    mask[10:18, 10:20] = 1
    mask[0, 29] = 1
    found = components(mask, least_area_px=2)
    assert [region.area_px for region in found] == [80, 9]
    assert found[0].box == (10, 10, 10, 8)
