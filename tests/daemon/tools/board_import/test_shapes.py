"""Bare metal of any shape, and where the needle goes on it; the boards are drawn here, the truth is known."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daemon.tools.board_import import boards_of
from daemon.tools.cad.model import Copy, Drill, Shape
from tests.daemon.tools.board_import.drawn import BOTH, HEIGHT_MM, TOP, WIDTH_MM, Drawing, disc, flash, mm, rectangle

CLOSE_MM = 0.006


@pytest.fixture
def drawing() -> Drawing:
    return Drawing()


def test_a_lone_rectangle_is_touched_in_its_middle_with_half_its_short_side_as_room(drawing: Drawing) -> None:
    drawing.pad("TP1", "1", "A", 10.0, 10.0, 0.3, 0.5)
    point = drawing.points()["TP1"]
    assert (point.shape, point.kind, point.diameter_um) == ("rectangle", "site", None)
    assert mm(point) == pytest.approx((10.0, 10.0), abs=CLOSE_MM)
    assert point.room_um == pytest.approx(150.0, abs=6.0)


@pytest.mark.parametrize("corner", [(0.2, 0.1), (-0.15, 0.2), (0.0, -0.25)])
def test_an_opening_that_lies_off_its_pad_moves_the_target_onto_the_metal_that_shows(
    drawing: Drawing, corner: tuple[float, float]
) -> None:
    dx, dy = corner
    drawing.paint("copper", rectangle(10.0, 10.0, 1.0, 0.8))
    drawing.paint("mask", rectangle(10.0 + dx, 10.0 + dy, 1.0, 0.8))
    drawing.pin("TP1", "1", "A", 10.0, 10.0)
    point = drawing.points()["TP1"]
    room_mm = min((0.8 - abs(dy)) / 2, (1.0 - abs(dx)) / 2)
    x, y = mm(point)
    inside = [0.5 - abs(x - 10.0), 0.4 - abs(y - 10.0), 0.5 - abs(x - 10.0 - dx), 0.4 - abs(y - 10.0 - dy)]
    assert min(inside) >= 0.9 * room_mm - CLOSE_MM
    assert point.room_um == pytest.approx(min(inside) * 1e3, abs=8.0)


def test_openings_drawn_as_strokes_regions_and_removals_count_alike(drawing: Drawing) -> None:
    drawing.paint("copper", rectangle(10.0, 10.0, 4.0, 1.0))
    drawing.paint(
        "mask", rectangle(9.0, 10.0, 1.0, 0.4), rectangle(10.0, 10.0, 1.2, 0.4), rectangle(11.0, 10.0, 1.0, 0.4)
    )
    drawing.paint("mask", Shape(rectangle(10.0, 10.0, 1.0, 0.6), dark=False))
    drawing.pin("TP1", "1", "A", 9.0, 10.0)
    drawing.pin("TP2", "1", "A", 11.0, 10.0)
    points = drawing.points()
    for name, x in (("TP1", 9.0), ("TP2", 11.0)):
        assert points[name].room_um == pytest.approx(200.0, abs=8.0)
        assert abs(mm(points[name])[0] - x) < 0.3
        xs = np.array(points[name].metal_um[0][::2]) / 1e3
        assert not ((xs > 9.51) & (xs < 10.49)).any(), "the part that is covered again is no bare metal"


def test_a_neighbours_trace_in_the_opening_is_not_the_pads_metal(drawing: Drawing) -> None:
    drawing.paint("copper", Shape(rectangle(10.0, 10.0, 0.6, 0.6), flashed=True), rectangle(10.5, 10.0, 0.2, 3.0))
    drawing.paint("mask", rectangle(10.2, 10.0, 1.4, 1.0))
    drawing.pin("TP1", "1", "A", 10.0, 10.0)
    point = drawing.points()["TP1"]
    assert mm(point) == pytest.approx((10.0, 10.0), abs=CLOSE_MM)
    assert max(point.metal_um[0][::2]) < 10_310


def test_pads_of_two_nets_that_touch_have_each_their_own_metal(drawing: Drawing) -> None:
    for number, x in ((1, 10.0), (2, 10.5)):
        drawing.round(f"TP{number}", "1", f"N{number}", x, 10.0, 0.5)
    points = drawing.points()
    for number, x in ((1, 10.0), (2, 10.5)):
        point = points[f"TP{number}"]
        assert (point.net, point.place_um, point.diameter_um) == (f"N{number}", (x * 1e3, 10_000.0), 500.0)
        xs = point.metal_um[0][::2]
        assert x * 1e3 - 258 < min(xs)
        assert max(xs) < x * 1e3 + 258


def test_a_via_in_the_middle_of_a_parts_pad_does_not_stand_for_the_pad(drawing: Drawing) -> None:
    for pin, x in (("1", 8.8), ("2", 11.2)):
        drawing.pad("R1", pin, f"N{pin}", x, 10.0, 1.2, 1.4)
    drawing.pins = [replace(p, width_mm=1.2, height_mm=1.4) for p in drawing.pins]
    drawing.paint("copper", flash(11.2, 10.0, 0.5))
    drawing.drills.append(Drill(11.2, 10.0, 0.25, plated=True))
    drawing.pin("", "", "N2", 11.2, 10.0, hole_mm=0.25, access=BOTH, width_mm=0.5, height_mm=0.0)
    point = drawing.points()["R1.2"]
    assert point.why_not is None
    assert max(point.metal_um[0][::2]) > 11_780
    assert mm(point)[0] > 11.3


@pytest.mark.parametrize(
    ("pad", "hole", "where", "why"),
    [
        (0.6, 0.3, "middle", None),
        (0.28, 0.1, None, "its pad is 0.28 mm, needs 0.30"),
        (0.6, 0.4, None, "ring 0.10 mm, needs 0.20"),
        (1.2, 0.75, "ring", None),
        (4.4, 2.2, "ring", None),
    ],
)
def test_a_via_is_touched_in_its_middle_where_its_hole_is_small_else_beside_it(
    drawing: Drawing, pad: float, hole: float, where: str | None, why: str | None
) -> None:
    drawing.ring("", "", "A", 10.0, 10.0, pad, hole)
    point = drawing.points()["VIA1"]
    assert point.why_not == why
    away = math.dist(mm(point), (10.0, 10.0))
    if where == "middle":
        assert away < CLOSE_MM
        assert point.stands_round
    elif where == "ring":
        assert away == pytest.approx((pad + hole) / 4, abs=0.02)
        assert not point.stands_round


def test_a_slot_is_gone_round(drawing: Drawing) -> None:
    drawing.paint("copper", rectangle(10.0, 10.0, 2.4, 1.4), side="bottom")
    drawing.paint("mask", rectangle(10.0, 10.0, 2.4, 1.4), side="bottom")
    drawing.drills.append(Drill(9.6, 10.0, 0.6, 10.4, 10.0))
    drawing.pin("J1", "1", "A", 10.0, 10.0, hole_mm=0.6, access=BOTH)
    drawing.pin("J1", "2", "B", 20.0, 10.0, hole_mm=0.6, access=BOTH)
    point = drawing.points(side="bottom")["J1.1"]
    x, y = 40.0 - point.x_um / 1e3, point.y_um / 1e3
    along = min(max(x, 9.6), 10.4)
    clear = math.dist((x, y), (along, 10.0)) - 0.3
    assert point.room_um is not None
    assert clear * 1e3 >= point.room_um - 6.0
    assert point.room_um >= 195.0


def test_a_via_in_a_bare_surface_is_touched_on_the_surface_near_it(drawing: Drawing) -> None:
    drawing.paint("copper", rectangle(20.0, 15.0, 30.0, 20.0))
    drawing.paint("mask", rectangle(20.0, 15.0, 28.0, 18.0))
    for x, y in ((15.0, 15.0), (25.0, 12.0)):
        drawing.drills.append(Drill(x, y, 0.3))
        drawing.pin("", "", "GND", x, y, hole_mm=0.3, access=TOP)
    for point, at in zip(drawing.points().values(), ((15.0, 15.0), (25.0, 12.0)), strict=True):
        assert point.probeable
        assert point.diameter_um is None
        assert 0.2 < math.dist(mm(point), at) < 1.0
        assert point.room_um is not None
        assert math.dist(mm(point), at) - 0.15 >= point.room_um / 1e3 - CLOSE_MM


def oblong(x: float, y: float, w: float, h: float) -> NDArray[np.float64]:
    """Return an upright oblong, h > w."""
    turns = np.linspace(0.0, np.pi, 46)
    arc = w / 2 * np.column_stack((np.cos(turns), np.sin(turns)))
    end = np.array((0.0, (h - w) / 2))
    points: NDArray[np.float64] = np.array((x, y)) + np.concatenate((arc + end, -arc - end))
    return points


@pytest.mark.parametrize("bare", [True, False])
@pytest.mark.parametrize(("ring_mm", "reached"), [(0.24, True), (0.215, True), (0.17, False)])
def test_the_ring_of_an_oval_pad_is_judged_alike_with_parts_and_without(
    drawing: Drawing, ring_mm: float, bare: bool, reached: bool
) -> None:
    for k in range(4):
        x, y = 6.0 + 5 * k, 9.0
        for side in ("top", "bottom"):
            drawing.paint("copper", oblong(x, y, 0.6 + 2 * ring_mm, 1.6 + 2 * ring_mm), side=side)
            drawing.paint("mask", oblong(x, y, 0.8 + 2 * ring_mm, 1.8 + 2 * ring_mm), side=side)
        drawing.drills.append(Drill(x, y - 0.5, 0.6, x, y + 0.5, plated=True))
        drawing.pin("J1", str(k), f"N{k}", x, y, hole_mm=0.6, access=BOTH)
    drawing.pad("R1", "1", "A", 20.0, 20.0, 1.0, 1.0)
    points = drawing.points(bare=bare, side="bottom")
    assert {points[f"J1.{k}"].probeable for k in range(4)} == {reached}, points["J1.0"].why_not
    assert reached or points["J1.0"].why_not == "ring 0.17 mm, needs 0.20"


@pytest.mark.parametrize("turn_deg", [0.0, 30.0, 45.0, 117.0])
def test_the_pads_of_a_turned_part_are_touched_at_their_free_ends(drawing: Drawing, turn_deg: float) -> None:
    along = np.array((math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))))
    for pin, way in (("1", -1), ("2", 1)):
        x, y = np.array((10.0, 10.0)) + way * 0.8 * along
        drawing.pad("R1", pin, f"N{pin}", float(x), float(y), 0.8, 0.95, turn_deg)
    for pin, way in (("1", -1), ("2", 1)):
        point = drawing.points()[f"R1.{pin}"]
        out = float((np.array(mm(point)) - 10.0) @ along) * way
        side = float((np.array(mm(point)) - 10.0) @ (-along[1], along[0]))
        assert 0.8 <= out <= 1.2 - 0.19
        assert abs(side) < 0.05
        assert point.room_um is not None
        assert 1.2 - out >= point.room_um / 1e3 - CLOSE_MM


def test_the_pads_of_a_ball_grid_lie_under_it_and_those_about_a_flat_package_do_not(drawing: Drawing) -> None:
    for row in range(5):
        for column in range(5):
            drawing.round("U1", f"{'ABCDE'[row]}{column}", f"N{row}{column}", 5 + column * 0.8, 5 + row * 0.8, 0.4)
    for i in range(8):
        drawing.pad("U2", f"{i}", f"L{i}", 18.0, 5 + i * 0.65, 1.0, 0.4)
        drawing.pad("U2", f"{15 - i}", f"R{i}", 22.0, 5 + i * 0.65, 1.0, 0.4)
    drawing.pad("U2", "17", "GND", 20.0, 5 + 3.5 * 0.65, 1.6, 3.0)
    points = drawing.points()
    assert {p.why_not for p in points.values() if p.part == "U1"} == {"it lies under U1"}
    assert points["U2.17"].why_not == "it lies under U2"
    legs = [p for p in points.values() if p.part == "U2" and p.pin != "17"]
    assert all(p.probeable for p in legs)
    assert all(p.x_um < 18_005 or p.x_um > 21_995 for p in legs), "outwards, not under the body"
    bare = drawing.points(bare=True)
    assert all(p.probeable for p in bare.values())


def test_a_part_of_pins_whose_holes_no_drill_file_has_is_judged(drawing: Drawing) -> None:
    for pin, x in enumerate((10.0, 12.54, 15.08)):
        drawing.ring("J1", str(pin), f"N{pin}", x, 10.0, 1.7, 1.0)
    drawing.drills.clear()
    assert {p.kind for p in drawing.points().values()} == {"pad"}


def test_a_part_whose_pins_have_no_numbers_is_a_part(drawing: Drawing) -> None:
    for column in range(5):
        for row in range(5):
            drawing.pad("U1", "", f"N{column}{row}", 10.0 + column, 10.0 + row, 0.5, 0.5)
    for way in (-1, 1):
        drawing.pad("R1", "", f"R{way}", 20.0 + way, 10.0, 0.8, 0.9)
    points = drawing.board().points
    assert not any(p.probeable for p in points if p.part == "U1"), "a grid lies over all of its pads"
    ends = [p for p in points if p.part == "R1" and p.probeable]
    assert len(ends) == 2
    assert all(abs(p.x_um - 20_000) > 1_000 for p in ends), "away from the body"


def test_a_drawn_body_leaves_the_metal_beyond_it_or_the_reason_with_the_number(drawing: Drawing) -> None:
    for part, x, toe in (("D1", 8.0, 0.5), ("D2", 20.0, 0.12)):
        for pin, way in (("1", -1), ("2", 1)):
            drawing.pad(part, pin, f"{part}{pin}", x + way * 2.0, 10.0, 1.6, 1.6)
        drawing.paint("fabrication", rectangle(x, 10.0, 2 * (2.8 - toe), 2.4))
    points = drawing.points()
    free = points["D1.2"]
    assert free.probeable
    assert mm(free)[0] == pytest.approx(8.0 + 2.8 - 0.25, abs=0.02)
    assert free.room_um == pytest.approx(250.0, abs=30.0)
    assert re.fullmatch(r"what is free of it beyond D2 is 0\.1\d mm, needs 0\.20", points["D2.1"].why_not or "")


@pytest.mark.parametrize("grow", [0.0, -0.5, 15.0])
def test_the_boards_edge_in_the_assembly_drawing_is_no_body(grow: float, drawing: Drawing) -> None:
    drawing.pad("TP1", "1", "A", 8.0, 10.0, 1.0, 1.0)
    for pin, way in (("1", -1), ("2", 1)):
        drawing.pad("R1", pin, f"R{pin}", WIDTH_MM / 2 + way, HEIGHT_MM / 2, 0.8, 0.9)
    outer = rectangle(WIDTH_MM / 2, HEIGHT_MM / 2, WIDTH_MM + 2 * grow, HEIGHT_MM + 2 * grow)
    inner = rectangle(WIDTH_MM / 2, HEIGHT_MM / 2, WIDTH_MM + 2 * grow - 0.3, HEIGHT_MM + 2 * grow - 0.3)
    drawing.paint("fabrication", Shape(outer), Shape(inner, dark=False))
    assert all(p.probeable for p in drawing.points().values())


def test_a_test_point_under_a_part_is_refused(drawing: Drawing) -> None:
    for pin, way in (("1", -1), ("2", 1)):
        drawing.pad("D1", pin, f"D{pin}", 8.0 + way * 3.0, 10.0, 1.6, 1.6)
    drawing.paint("fabrication", rectangle(8.0, 10.0, 5.0, 3.0))
    drawing.round("TP1", "1", "A", 8.0, 10.0, 1.0)
    assert drawing.points()["TP1"].why_not == "it lies under D1"
    assert drawing.points(bare=True)["TP1"].probeable


def test_letters_of_the_assembly_drawing_are_no_bodies(drawing: Drawing) -> None:
    drawing.round("TP1", "1", "A", 8.0, 10.0, 0.6)
    outer, inner = disc(8.0, 10.0, 1.2), disc(8.0, 10.0, 0.9)
    drawing.paint("fabrication", outer, Shape(inner, dark=False))
    assert drawing.points()["TP1"].probeable


def test_three_lone_rounds_alike_are_fiducials_and_nothing_else_is(drawing: Drawing) -> None:
    for x, y in ((3.0, 3.0), (37.0, 3.0), (3.0, 27.0)):
        drawing.round("", "", "", x, y, 1.0, 2.0)
    for x in (10.0, 12.0, 14.0):
        drawing.round("", "", "", x, 20.0, 0.2, 0.6)  # dots of a logo
        drawing.ring("H", f"{x}", "GND", x, 25.0, 3.0, 2.0)  # mounting holes
    drawing.pins = [p for p in drawing.pins if p.part != "H"]
    drawing.round("", "", "", 30.0, 20.0, 1.5, 3.0)  # one alone
    fiducials = [p for p in drawing.points().values() if p.kind == "fiducial"]
    assert sorted(mm(p) for p in fiducials) == [(3.0, 3.0), (3.0, 27.0), (37.0, 3.0)]
    assert all(p.why_not == "a fiducial" and p.diameter_um == 1000.0 for p in fiducials)
    others = [p for p in drawing.points().values() if p.kind != "fiducial"]
    assert all(p.why_not == "not in the netlist" for p in others)


def test_the_order_of_a_net_is_test_point_open_via_ring_land_pad_and_a_connectors_pad_last(drawing: Drawing) -> None:
    drawing.round("TP1", "1", "A", 5.0, 5.0, 1.0)
    drawing.ring("", "", "A", 8.0, 5.0, 0.6, 0.3)
    drawing.pad("R1", "1", "A", 11.0, 5.0, 0.9, 1.0)
    drawing.pad("R1", "2", "B", 13.0, 5.0, 0.9, 1.0)
    drawing.pad("J1", "1", "A", 20.0, 5.0, 0.9, 2.0)
    drawing.pad("J1", "2", "B", 22.0, 5.0, 0.9, 2.0)
    drawing.pad("W1", "1", "A", 30.0, 5.0, 0.9, 1.2)
    assert [p.name for p in drawing.board().of_net("A")] == ["TP1", "VIA1", "W1.1", "R1.1", "J1.1"]


@pytest.mark.parametrize("seed", range(12))
def test_on_any_turned_pad_with_any_opening_and_hole_the_target_has_the_room_it_says(seed: int) -> None:
    chance = np.random.default_rng(seed)
    drawing = Drawing()
    facts = {}
    for i in range(20):
        x, y = 4.0 + 7.0 * (i % 5), 4.0 + 7.0 * (i // 5)
        w, h, turn = chance.uniform(0.3, 3.0), chance.uniform(0.3, 3.0), chance.uniform(0, 180)
        ow, oh, o_turn = chance.uniform(0.4, 4.0), chance.uniform(0.4, 4.0), chance.uniform(0, 180)
        dx, dy = chance.uniform(-0.2, 0.2, 2)
        hole = chance.choice([0.0, 0.0, 0.2, 0.5, 1.0])
        drawing.paint("copper", rectangle(x, y, w, h, turn))
        drawing.paint("mask", rectangle(x + dx, y + dy, ow, oh, o_turn))
        if hole:
            drawing.drills.append(Drill(x, y, float(hole)))
        drawing.pin(f"TP{i}", "1", f"N{i}", x, y, hole_mm=float(hole) or None)
        facts[f"TP{i}"] = ((x, y, w, h, turn), (x + dx, y + dy, ow, oh, o_turn), (x, y, hole))
    offered = [p for p in drawing.points().values() if p.probeable]
    assert len(offered) > 8
    for point in offered:
        pad, opening, (hx, hy, hole) = facts[point.name]
        x, y = mm(point)
        room = min(_inside(x, y, *pad), _inside(x, y, *opening))
        if hole:
            room = min(room, math.dist((x, y), (hx, hy)) - hole / 2)
        assert point.room_um is not None
        assert room * 1e3 >= 0.975 * point.room_um - 8.0, (point.name, room, facts[point.name])


def _inside(x: float, y: float, cx: float, cy: float, w: float, h: float, turn_deg: float) -> float:
    """Return how far inside of a turned rectangle a place lies; negative outside."""
    c, s = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
    u, v = (x - cx) * c + (y - cy) * s, -(x - cx) * s + (y - cy) * c
    return min(w / 2 - abs(u), h / 2 - abs(v))


def test_flashes_give_round_pads_their_exact_places(drawing: Drawing) -> None:
    drawing.paint("copper", flash(10.0123, 9.9871, 0.45))
    drawing.paint("mask", rectangle(10.0, 10.0, 2.0, 2.0))
    drawing.pin("TP1", "1", "A", 10.01, 9.99)
    point = drawing.points()["TP1"]
    assert (point.x_um, point.y_um, point.diameter_um) == (10_012.3, 9_987.1, 450.0)


def test_on_a_panel_the_pads_of_other_boards_are_neither_points_nor_fiducials(drawing: Drawing) -> None:
    """Two boards, the second turned by 180 degrees; each has three marks that the netlist names and a test point."""
    places = {"FID1": (2.0, 2.0), "FID2": (12.0, 2.0), "FID3": (2.0, 12.0), "TP1": (6.0, 7.0)}
    for name, (x, y) in places.items():
        drawing.round(name, "1", "A" if name == "TP1" else "N/C", x, y, 1.0, 2.0)
        drawing.round("", "", "", 36.0 - x, 26.0 - y, 1.0, 2.0)
    cad = replace(drawing.cad(), copies=(Copy("1", 0.0, 0.0, 0.0, 15.0), Copy("2", 36.0, 26.0, 180.0, 15.0)))
    boards = boards_of(cad)
    assert sorted(p.name for p in boards["top"].points) == ["FID1", "FID2", "FID3", "TP1"]
    assert [(c.x_um, c.y_um, c.turn_deg) for c in boards["top"].copies] == [
        (0.0, 0.0, 0.0),
        (36_000.0, 26_000.0, 180.0),
    ]
    assert [(c.x_um, c.turn_deg) for c in boards["bottom"].copies] == [
        (25_000.0, 0.0),
        (19_000.0, 180.0),
    ]
