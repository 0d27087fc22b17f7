from dataclasses import replace

import numpy as np

from tests.vision.registration.drawn import Lie, box, shoot, some_board
from vision.registration import (
    LayerFit,
    Polygon,
    Registration,
    SideLayers,
    fit_layers,
    index_side,
    median_shifts,
    place_known,
    prepare,
    register,
    unique_places,
)


def _shifted(polygons: tuple[Polygon, ...], dx: float, dy: float) -> tuple[Polygon, ...]:
    return tuple(replace(p, points_um=p.points_um + np.array((dx, dy))) for p in polygons)


def test_ink_and_openings_off_their_copper_are_measured_and_no_longer_pull_the_place() -> None:
    layers, targets = some_board(3)
    real = replace(layers, ink=_shifted(layers.ink, 140.0, -100.0), openings=_shifted(layers.openings, -30.0, 40.0))
    indexed = index_side(layers)
    rng = np.random.default_rng(1)
    fits, shots = [], []
    for target in targets[:8]:
        at = (target.x_um, target.y_um)
        shot = shoot(real, target, Lie(*rng.uniform(-40, 40, 2)), rng)
        found = place_known(register(prepare(indexed, at), shot.frame, shot.assumed, target))
        if found is not None:
            fit = fit_layers(indexed, at, shot.frame, shot.assumed, found)
            assert isinstance(fit, LayerFit)
            fits.append(fit)
        shots.append((target, shot))
    assert len(fits) >= 3
    shifts = median_shifts(fits)
    assert np.allclose(shifts.ink_um, (140.0, -100.0), atol=20.0)
    assert np.allclose(shifts.openings_um, (-30.0, 40.0), atol=12.0)
    off = []
    for target, shot in shots:
        at = (target.x_um, target.y_um)
        answer = register(prepare(indexed, at, shifts), shot.frame, shot.assumed, target)
        assert isinstance(answer, Registration)
        off.append(np.hypot(*(np.asarray(answer.target_px) - shot.truth_px(target))))
    assert np.sqrt(np.mean(np.square(off))) < 0.6


def test_looks_that_see_too_little_of_a_layer_say_nothing_of_it() -> None:
    layers, targets = some_board(3)
    bare = replace(layers, ink=())
    target = targets[0]
    shot = shoot(bare, target, Lie(), np.random.default_rng(2))
    answer = register(prepare(bare, (target.x_um, target.y_um)), shot.frame, shot.assumed, target)
    assert isinstance(answer, Registration)
    fit = fit_layers(index_side(bare), (target.x_um, target.y_um), shot.frame, shot.assumed, answer)
    assert isinstance(fit, LayerFit)
    assert np.isinf(fit.ink_sigma_um)
    assert median_shifts([fit]).ink_um == (0.0, 0.0)


def test_places_alike_in_all_corners_are_not_chosen_as_unique() -> None:
    layers, _ = some_board(5)
    # The same cross of pads in all four corners, turned as the board is turned.
    corner = [(-1500.0, 0.0), (1500.0, 0.0), (0.0, 1500.0), (0.0, -1500.0), (0.0, 0.0)]
    middles = [(5000.0, 5000.0), (31_000.0, 5000.0), (5000.0, 23_000.0), (31_000.0, 23_000.0)]

    def cleared(polygons: tuple[Polygon, ...], extra: list[Polygon]) -> tuple[Polygon, ...]:
        far = [p for p in polygons
               if all(np.hypot(*(p.points_um.mean(axis=0) - m)) > 6500.0 for m in middles)]  # fmt: skip
        return (*far, *extra)

    pads = [Polygon(box(x + dx, y + dy, 900.0, 900.0)) for x, y in middles for dx, dy in corner]
    layers = SideLayers(cleared(layers.copper, pads), cleared(layers.openings, pads), cleared(layers.ink, []), (),
                        layers.outline)  # fmt: skip
    places = unique_places(layers, None, count=3)
    assert len(places) == 3
    assert places[0].rival_score <= places[1].rival_score
    for place in places[:2]:
        assert min(np.hypot(place.x_um - x, place.y_um - y) for x, y in middles) > 2500.0


def test_a_side_that_is_also_the_other_side_is_a_rival_of_itself() -> None:
    layers, _ = some_board(6)
    alone, both = unique_places(layers, None, count=1), unique_places(layers, layers, count=1)
    assert alone[0].rival_score < 0.8
    assert both[0].rival_score > 0.95
    assert both[0].rival == "other side"


def test_a_board_with_little_bare_metal_has_places_too_and_where_there_is_more_they_come_first() -> None:
    layers, _ = some_board(7)
    poor = unique_places(replace(layers, openings=layers.openings[::16]), None, count=8, apart_um=6000.0)
    across = [place.x_um for place in poor if place.rival_score < 0.9]
    assert max(across) - min(across) > 10_000.0
    left = [p for n, p in enumerate(layers.openings) if p.points_um[:, 0].mean() <= 18_000.0 and n % 8 == 0]
    right = [p for p in layers.openings if p.points_um[:, 0].mean() > 18_000.0]
    mixed = unique_places(replace(layers, openings=(*left, *right)), None, count=4, apart_um=6000.0)
    assert all(place.x_um > 15_000.0 for place in mixed)
