import numpy as np
import pytest

from tests.vision.registration.drawn import box, circle
from vision.registration import Hole, LayerShifts, Polygon, SideLayers, index_side
from vision.registration.drawing import Material, Planes, average, average_packed, coarser, draw_labels
from vision.registration.reference import usual_picture, usual_picture_of

ALL = Polygon(box(0.0, 0.0, 20_000.0, 20_000.0))


def side(**layers: tuple[Polygon, ...] | tuple[Hole, ...]) -> SideLayers:
    given = {"copper": (), "openings": (), "ink": (), "holes": (), "outline": (ALL,), **layers}
    return SideLayers(**given)  # type: ignore[arg-type]


def at(layers: SideLayers, x: float, y: float, shifts: LayerShifts | None = None) -> Material:
    labels = draw_labels(index_side(layers), (x - 20.0, y - 20.0), 4.0, 10, shifts or LayerShifts())
    return Material(int(labels[5, 5]))


def test_a_place_is_what_its_layers_make_it() -> None:
    layers = side(
        copper=(Polygon(box(0, 0, 1000, 1000)), Polygon(box(3000, 0, 1000, 1000))),
        openings=(Polygon(box(0, 0, 1200, 1200)),),
        ink=(Polygon(box(5000, 0, 400, 400)),),
        holes=(Hole(0.0, 0.0, 300.0), Hole(3000.0, 0.0, 300.0)),
        bodies=(Polygon(box(0, 4000, 800, 800)),),
    )
    assert at(layers, 0, 0) is Material.HOLE
    assert at(layers, 400, 0) is Material.METAL
    assert at(layers, 560, 0) is Material.LAMINATE
    assert at(layers, 3300, 0) is Material.COVERED_COPPER
    assert at(layers, 3000, 0) is Material.MASK
    assert at(layers, 5000, 0) is Material.INK
    assert at(layers, 0, 4000) is Material.UNKNOWN
    assert at(layers, 0, -4000) is Material.MASK
    assert at(layers, 11_000, 0) is Material.OFF_BOARD


def test_later_polygons_remove_what_earlier_ones_drew_and_may_draw_it_again() -> None:
    copper = (Polygon(box(0, 0, 2000, 2000)), Polygon(box(0, 0, 1000, 1000), dark=False), Polygon(box(0, 0, 400, 400)))
    layers = side(copper=copper, openings=(Polygon(box(0, 0, 3000, 3000)),))
    assert [at(layers, x, 0) for x in (0, 350, 800)] == [Material.METAL, Material.LAMINATE, Material.METAL]


def test_polygons_that_overlap_do_not_cancel() -> None:
    copper = (Polygon(box(0, 0, 1000, 1000)), Polygon(box(400, 0, 1000, 1000)))
    assert at(side(copper=copper, openings=(ALL,)), 300, 0) is Material.METAL


def test_a_capped_hole_is_metal_in_its_opening() -> None:
    layers = side(openings=(ALL,), copper=(Polygon(circle(0, 0, 600)),), holes=(Hole(0.0, 0.0, 300.0, covered=True),))
    assert at(layers, 0, 0) is Material.METAL


def test_a_cut_out_of_the_outline_is_no_board() -> None:
    layers = side(outline=(ALL, Polygon(box(0, 0, 1000, 1000), dark=False)))
    assert at(layers, 0, 0) is Material.OFF_BOARD


def test_ink_and_openings_move_by_their_shifts_alone() -> None:
    layers = side(
        copper=(Polygon(box(0, 0, 1000, 1000)),),
        openings=(Polygon(box(0, 0, 1000, 1000)),),
        ink=(Polygon(box(3000, 0, 400, 400)),),
    )
    shifts = LayerShifts(ink_um=(300.0, 0.0), openings_um=(0.0, 100.0))
    assert at(layers, 3450, 0) is Material.MASK
    assert at(layers, 3450, 0, shifts) is Material.INK
    assert at(layers, 0, -460, shifts) is Material.COVERED_COPPER
    assert at(layers, 0, 560, shifts) is Material.LAMINATE


@pytest.mark.parametrize(("texel_um", "factor"), [(2.0, 6), (16.0, 3), (32.0, 3)])
def test_shares_of_cells_are_true_to_size_and_place(texel_um: float, factor: int) -> None:
    rng = np.random.default_rng(1)
    cells = int(3000 / texel_um / factor) // 2 * 2
    areas, places = [], []
    for _ in range(40):
        x, y = rng.uniform(1100, 1700, 2)
        wide, high = rng.uniform(300, 900, 2)
        layers = index_side(side(copper=(Polygon(box(x, y, wide, high)),), openings=(ALL,)))
        labels = draw_labels(layers, (0.0, 0.0), texel_um, cells * factor, LayerShifts())
        planes = average(labels, (0.0, 0.0), texel_um, factor)
        metal, grid = planes.cover[Material.METAL].astype(np.float64), planes.grid
        rows, columns = np.mgrid[: grid.rows, : grid.columns] * grid.cell_um
        areas.append(metal.sum() * grid.cell_um**2 / (wide * high))
        places.append((np.sum(metal * columns) / metal.sum() + grid.origin_um[0] - x,
                       np.sum(metal * rows) / metal.sum() + grid.origin_um[1] - y))  # fmt: skip
    assert np.mean(areas) == pytest.approx(1.0, abs=0.01)
    assert np.abs(np.mean(places, axis=0)).max() < 0.12 * texel_um


def test_solder_is_seen_on_bare_metal_alone() -> None:
    layers = SideLayers(
        copper=(Polygon(box(0, 0, 400, 400)),),
        openings=(Polygon(box(0, 0, 600, 600)),),
        ink=(),
        holes=(),
        outline=(),
        bodies=(Polygon(box(0, 0, 100, 100)),),
        soldered=(Polygon(box(0, 0, 500, 500)),),
    )
    labels = draw_labels(index_side(layers), (-500.0, -500.0), 10.0, 100, LayerShifts())

    def at(x_um: float, y_um: float) -> int:
        return int(labels[int((y_um + 500.0) / 10.0), int((x_um + 500.0) / 10.0)])

    assert at(0, 0) == Material.UNKNOWN  # the part
    assert at(150, 0) == Material.SOLDER
    assert at(230, 0) == Material.LAMINATE  # in the opening, but no metal to be soldered
    assert at(400, 0) == Material.MASK


def test_polygons_are_indexed_together_as_each_would_be_alone() -> None:
    shapes = [box(0, 0, 900, 500), circle(3000.0, 0.0, 700.0), box(2000, 1000, 40, 40)[::-1], box(0, 0, 900, 500)[:3]]
    twice = np.repeat(shapes[0], 2, axis=0)
    polygons = [Polygon(points, dark=k != 2) for k, points in enumerate([*shapes, twice])]
    line = Polygon(box(0, 0, 100, 100)[:2])
    joined = index_side(side(copper=(*polygons, line))).copper
    assert joined.dark.tolist() == [True, True, False, True, True]
    for k, polygon in enumerate(polygons):
        alone = index_side(side(copper=(polygon,))).copper
        assert np.array_equal(joined.points[k], polygon.points_um)
        assert np.array_equal(joined.inward[k], alone.inward[0])
        assert np.array_equal(joined.boxes[k], alone.boxes[0])
    clockwise, square = joined.inward[2], joined.points[2]
    middle = square.mean(axis=0)
    assert (np.sum(clockwise * (middle - square), axis=1) > 0.0).all()
    assert len(index_side(side()).copper.boxes) == 0


def test_packed_planes_say_what_planes_do_and_more_than_one_band_of_rows_is_drawn() -> None:
    layers = side(copper=(Polygon(circle(300.0, 9000.0, 7000.0)),), openings=(Polygon(circle(500.0, 9000.0, 6000.0)),))
    labels = draw_labels(index_side(layers), (-4000.0, 0.0), 40.0, 450, LayerShifts())
    plain, packed = (draw(labels, (-4000.0, 0.0), 40.0, 3) for draw in (average, average_packed))
    for material in Material:
        share = (labels == material).reshape(150, 3, 150, 3).mean(axis=(1, 3))
        assert plain.cover[material] == pytest.approx(share, abs=0.5 / 255)
        assert np.array_equal(packed.plane(material), plain.cover[material])
    one, other = (planes.around(200.0, 8000.0, 3000.0) for planes in (plain, packed))
    assert np.array_equal(one.cover, other.cover)
    assert one.grid.origin_um == other.grid.origin_um
    assert usual_picture_of(packed) == pytest.approx(usual_picture(plain), abs=1e-6)
    half = coarser(packed, 2)
    assert isinstance(half, Planes)
    assert half.cover == pytest.approx(plain.cover.reshape(9, 75, 2, 75, 2).mean(axis=(2, 4)), abs=1e-6)
