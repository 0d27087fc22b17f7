"""Rivals are searched for and tried only as far as an answer needs, and that changes no answer."""

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from tests.vision.registration.drawn import box, some_board
from vision.registration import Polygon, SideLayers, draw_whole, spectra, unique, unique_places
from vision.registration.drawing import Grid, Material, Planes
from vision.registration.rectify import Picture, Pose
from vision.registration.register import LEAST_ALONE
from vision.registration.rival import Searched, Trial

PLACE, SPLIT_UM = (12_000.0, 9000.0), 26_000.0


@lru_cache(maxsize=1)
def _assembled() -> SideLayers:
    layers, _ = some_board(21)
    return replace(layers, bodies=(Polygon(box(16_000.0, 9000.0, 4000.0, 3000.0)),))


@lru_cache(maxsize=1)
def _sides() -> tuple[Searched, ...]:
    return Searched(draw_whole(_assembled())), Searched(draw_whole(some_board(22)[0]))


def _fields(rows: int, *, unknown: bool) -> Planes:
    """Return planes of blocks of a few materials."""
    rng = np.random.default_rng(3)
    kinds = [Material.OFF_BOARD, Material.MASK, Material.INK, Material.METAL, *([Material.UNKNOWN] if unknown else [])]
    labels = np.kron(rng.choice(kinds, (rows // 3 + 1, rows // 3 + 1)), np.ones((3, 3), dtype=np.int64))[:rows, :rows]
    cover = np.stack([labels == material for material in Material]).astype(np.float32)
    return Planes(Grid((0.0, 0.0), 192.0, rows, rows), cover)


def _ratio(cover: np.ndarray, picture: np.ndarray, seen: np.ndarray) -> float:
    """Return the share of the picture's variance that lies between the materials' means, cell by cell."""
    known = [m for m in Material if m is not Material.UNKNOWN]
    weight = cover[known] * seen
    counts, sums = weight.sum(axis=(1, 2)), (weight * picture).sum(axis=(1, 2))
    mean = sums.sum() / counts.sum()
    there = counts > 0.5
    between = (counts[there] * (sums[there] / counts[there] - mean) ** 2).sum()
    return float(between / (weight.sum(axis=0) * (picture - mean) ** 2).sum())


@pytest.mark.parametrize("unknown", [False, True])
def test_the_ratio_by_transforms_is_that_of_the_cells(unknown: bool) -> None:
    rows, size = 47, 12
    planes, rng = _fields(rows, unknown=unknown), np.random.default_rng(4)
    picture = (60.0 + 120.0 * planes.cover[Material.METAL][20:32, 9:21] + rng.normal(0.0, 9.0, (size, size))).astype(
        np.float32
    )
    seen = rng.random((size, size)) < 0.9
    found = spectra.correlation_ratio(spectra.transform_all(planes, size), picture, seen, metal=False)
    assert found.shape == (rows - size + 1, rows - size + 1)
    assert np.unravel_index(int(np.argmax(found)), found.shape) == (20, 9)
    for row, column in ((20, 9), (0, 0), (35, 35), (3, 30), (17, 6)):
        there = planes.cover[:, row : row + size, column : column + size]
        metal, mask = (float((picture * seen * there[m]).sum() / (seen * there[m]).sum())
                       for m in (Material.METAL, Material.MASK))  # fmt: skip
        wanted = _ratio(there, picture, seen) * (spectra.DARK_METAL if metal <= mask else 1.0)
        assert found[row, column] == pytest.approx(wanted, abs=1e-4)


def test_transforms_serve_no_window_larger_than_they_were_made_for() -> None:
    with pytest.raises(ValueError, match="do not serve one of 15"):
        spectra.for_window(spectra.transform_all(_fields(47, unknown=False), 14), 15)


def test_transforms_made_for_one_window_serve_smaller_ones() -> None:
    planes = _fields(47, unknown=True)
    picture, seen = planes.cover[Material.METAL][5:19, 8:22], np.ones((14, 14), dtype=np.bool_)
    own = spectra.correlation_ratio(spectra.transform_all(planes, 14), picture, seen)
    shared = spectra.correlation_ratio(spectra.for_window(spectra.transform_all(planes, 30), 14), picture, seen)
    assert np.array_equal(own, shared)


@pytest.mark.parametrize(
    ("rows", "columns", "size_of_transforms"),
    [((20, 38), (6, 55), (30, 60)), ((0, 60), (25, 31), (60, 18)), ((4, 60), (1, 58), (60, 60))],
)
def test_the_bench_beside_a_board_is_searched_no_farther_than_windows_see_the_board(
    rows: tuple[int, int], columns: tuple[int, int], size_of_transforms: tuple[int, int]
) -> None:
    blocks, cells, size = _fields(60, unknown=True), 60, 12
    cover = np.zeros_like(blocks.cover)
    cover[Material.OFF_BOARD] = 1.0
    board = np.s_[:, rows[0] : rows[1], columns[0] : columns[1]]
    cover[board] = blocks.cover[board]
    # Without metal there is no factor on the ratio.
    cover[Material.INK] += cover[Material.METAL]
    cover[Material.METAL] = 0.0
    rng = np.random.default_rng(6)
    picture, seen = rng.normal(90.0, 30.0, (size, size)).astype(np.float32), rng.random((size, size)) < 0.8
    transformed = spectra.transform_all(Planes(blocks.grid, cover), size)
    found = spectra.correlation_ratio(transformed, picture, seen, metal=False)
    assert transformed.size == size_of_transforms
    lags = range(cells - size + 1)
    for row in lags:
        for column in lags:
            there = cover[:, row : row + size, column : column + size]
            if float((np.delete(there, Material.UNKNOWN, axis=0) * seen).sum()) > 0.3 * size**2:
                assert found[row, column] == pytest.approx(_ratio(there, picture, seen), abs=1e-4)


def test_a_picture_by_another_map_shows_and_hides_what_its_own_would() -> None:
    rng = np.random.default_rng(5)
    plane = rng.integers(0, 255, (200, 300), dtype=np.uint8)
    hidden = [box(120.0, 80.0, 60.0, 30.0), box(20.0, 150.0, 30.0, 30.0)]
    picture = Picture.of(plane, np.eye(3), hidden)
    grid = Grid((10.0, 10.0), 2.0, 60, 90)
    for turn_deg in (0.0, 30.0):
        to_px = Pose(5.0, -3.0, turn_deg, (100.0, 80.0)).matrix
        for per_cell in (1.0, 2.0):
            shared = picture.under(to_px).on(grid, Pose(), per_cell)
            own = Picture.of(plane, to_px, hidden).on(grid, Pose(), per_cell)
            for one, other in zip(shared, own, strict=True):
                assert np.array_equal(one, other)


def test_a_trial_ends_at_the_first_rival_that_is_too_near_and_goes_on_when_more_is_asked() -> None:
    whole, tried = Trial(PLACE, _sides(), LEAST_ALONE), Trial(PLACE, _sides(), LEAST_ALONE)
    assert whole.stays_within(math.inf)
    assert whole.ended
    assert whole.nearness > 0.1
    assert not tried.stays_within(0.1 * whole.nearness)
    assert not tried.ended
    assert tried.nearness <= whole.nearness
    assert tried.stays_within(whole.nearness)
    assert tried.ended
    assert tried.nearest == whole.nearest
    assert tried.nearness == whole.nearness


def _partly_alike() -> SideLayers:
    """Return another side that is the same left of a line."""
    here, there = _assembled(), some_board(22)[0]

    def mixed(one: tuple[Polygon, ...], other: tuple[Polygon, ...]) -> tuple[Polygon, ...]:
        left = (p for p in one if p.points_um[:, 0].max() < SPLIT_UM)
        return (*left, *(p for p in other if p.points_um[:, 0].min() > SPLIT_UM))

    copper, openings = mixed(here.copper, there.copper), mixed(here.openings, there.openings)
    return replace(here, copper=copper, openings=openings, ink=mixed(here.ink, there.ink))


def test_places_are_those_that_trials_of_every_rival_give(monkeypatch: pytest.MonkeyPatch) -> None:
    sides = _assembled(), _partly_alike()
    monkeypatch.setattr(unique, "MOST_TRIED", 4)
    lazy = unique_places(*sides, count=6, apart_um=12_000.0)
    once = [place.rival_score <= unique.UNIQUE_SCORE for place in lazy]
    assert len(lazy) == 6
    assert any(once)
    assert not all(once)

    class Exhaustive(Trial):
        def stays_within(self, nearness: float) -> bool:
            super().stays_within(math.inf)
            return self.nearness <= nearness

    monkeypatch.setattr(unique, "Trial", Exhaustive)
    assert unique_places(*sides, count=6, apart_um=12_000.0) == lazy
