"""What lies under a place of a board: metal with its net, pin and distance to the edge, or what else."""

from pathlib import Path

import pytest

from sim_hw.board.board import Board, load_board
from sim_hw.board.surface import Spot, Surface
from tests.sim_hw.scene_double import DEMO, SHARED_BOARDS
from tests.sim_hw.small_board import RectPad, write_board

GOOD_UM = 3.0
"""What the raster of 2 um may be off."""


@pytest.fixture(scope="module")
def board(tmp_path_factory: pytest.TempPathFactory) -> Board:
    return load_board(write_board(tmp_path_factory.mktemp("small")))


@pytest.fixture(scope="module")
def surface(board: Board) -> Surface:
    return Surface(board)


def named(spot: Spot) -> tuple[str, str | None, str | None]:
    return spot.what, spot.net, spot.pin


@pytest.mark.parametrize(
    ("x_mm", "y_mm", "pin", "net", "inside_um"),
    [
        (3.0, 3.0, "R1.1", "VIN", 150.0),  # the short half of 0.5 x 0.3
        (3.2, 3.0, "R1.1", "VIN", 50.0),
        (4.4, 3.12, "R1.2", "GND", 30.0),
        (8.0, 3.4, "U1.1", "SDA", 100.0),
        (9.5, 5.0, "U1.3", "GND", 750.0),  # beyond the finest window
        (8.4, 4.6, "U1.3", "GND", 350.0),
        (4.0 + 0.65, 10.0, "J1.1", "VIN", 150.0),  # the middle of a ring of 0.3
        (16.0, 10.225, "VIA", "GND", 75.0),
    ],
)
def test_metal_is_told_by_net_pin_and_distance_to_its_edge(
    surface: Surface, x_mm: float, y_mm: float, pin: str, net: str, inside_um: float
) -> None:
    spot = surface.at(x_mm, y_mm)
    assert named(spot) == ("metal", net, pin)
    assert spot.inside_um == pytest.approx(inside_um, abs=GOOD_UM)
    assert (spot.touches, spot.nets, spot.away_um) == (("metal",), (net,), None)


@pytest.mark.parametrize(
    ("x_mm", "y_mm", "what", "pin", "away_um"),
    [
        (4.0, 10.0, "hole", "J1.1", 500.0),
        (3.28, 3.0, "laminate", "R1.1", 30.0),
        (3.7, 3.0, "mask", "R1.1", 450.0),
        (6.0, 13.0, "mask", "J1.2", None),  # copper under mask
        (-0.5, 3.0, "off_board", None, None),
    ],
)
def test_what_is_no_metal_is_told_with_the_nearest_metal(
    surface: Surface, x_mm: float, y_mm: float, what: str, pin: str | None, away_um: float | None
) -> None:
    spot = surface.at(x_mm, y_mm)
    assert (spot.what, spot.inside_um) == (what, None)
    if away_um is not None:
        assert spot.pin == pin
        assert spot.away_um == pytest.approx(away_um, abs=GOOD_UM)


def test_what_else_the_needles_end_touches_is_told(surface: Surface) -> None:
    assert surface.at(3.24, 3.0, reach_um=25.0).touches == ("laminate", "metal")
    assert surface.at(4.0 + 0.52, 10.0, reach_um=25.0).touches == ("hole", "metal")
    between = surface.at(8.16, 3.0, reach_um=25.0)  # 30 um lie between the two pads
    assert between.nets == ("SCL", "SDA")
    assert between.what == "laminate"


def test_pads_that_share_an_opening_are_told_apart_by_their_copper(tmp_path: Path) -> None:
    pads = [RectPad("U1", str(k), f"N{k}", 5.0 + 0.5 * k, 5.0, 0.3, 1.0, opening_mm=0.2) for k in range(1, 5)]
    surface = Surface(load_board(write_board(tmp_path, pads)))
    assert [surface.at(5.0 + 0.5 * k, 5.3).pin for k in range(1, 5)] == ["U1.1", "U1.2", "U1.3", "U1.4"]


def test_an_opening_smaller_than_the_pad_is_the_edge(tmp_path: Path) -> None:
    surface = Surface(load_board(write_board(tmp_path, [RectPad("R1", "1", "A", 5.0, 5.0, 0.6, 0.6, opening_mm=-0.1)])))
    assert surface.at(5.0, 5.0).inside_um == pytest.approx(200.0, abs=GOOD_UM)
    assert surface.at(5.25, 5.0).what == "mask"


@pytest.mark.parametrize(
    ("shift_mm", "place_mm", "inside_um"),
    [((0.0, 0.0), (2.9, 3.0), 150.0), ((0.15, 0.0), (2.9, 3.0), 50.0), ((0.0, -0.15), (3.0, 3.0), 50.0)],
)
def test_openings_that_are_shifted_leave_other_metal_bare(
    board: Board, shift_mm: tuple[float, float], place_mm: tuple[float, float], inside_um: float
) -> None:
    assert Surface(board, mask_shift_mm=shift_mm).at(*place_mm).inside_um == pytest.approx(inside_um, abs=GOOD_UM)


def test_the_demo_boards_rounds_are_as_large_as_they_are() -> None:
    demo = load_board(DEMO)
    surface = Surface(demo)
    for target in demo.targets:
        aside_mm = 0.35 * target.pad_diameter_mm
        ways = ((aside_mm, 0.0), (-aside_mm, 0.0), (0.0, aside_mm), (0.0, -aside_mm))
        spots = [surface.at(target.x_mm + dx, target.y_mm + dy) for dx, dy in ways]
        assert {(spot.what, spot.net) for spot in spots} == {("metal", target.net)}
        beyond_hole_mm = aside_mm - target.hole_diameter_mm / 2 if target.hole_diameter_mm else aside_mm
        # A track that leaves a pad under the mask's opening is metal too: the least of four sides is the round's own.
        least_um = min(spot.inside_um or 0.0 for spot in spots)
        assert least_um == pytest.approx(1e3 * min(0.15 * target.pad_diameter_mm, beyond_hole_mm), abs=GOOD_UM)


@pytest.mark.skipif(not SHARED_BOARDS.is_dir(), reason="no real boards lie beside the project")
@pytest.mark.parametrize("side", ["top", "bottom"])
@pytest.mark.parametrize("name", ["F1Tenth-powerboard", "cloud-dripper", "bioreactor", "pico-ice-rev1"])
def test_bare_metal_at_the_place_of_a_pin_is_that_pins(name: str, side: str) -> None:
    board = load_board(SHARED_BOARDS / name, side)
    surface = Surface(board)
    pins = [pad for pad in board.pads if not pad.is_via and pad.net]
    spots = [(pin, surface.at(pin.x_mm, pin.y_mm)) for pin in pins[:: max(1, len(pins) // 60)]]
    metal = [(pin, spot) for pin, spot in spots if spot.what == "metal"]
    assert all(spot.net == pin.net for pin, spot in metal)
    around = [(pin, spot) for pin, spot in spots if spot.what == "hole"]
    assert all(spot.net == pin.net for pin, spot in around if spot.away_um is not None and spot.away_um < 1e3)
    assert len(metal) + len(around) > 10 or side == "bottom"
