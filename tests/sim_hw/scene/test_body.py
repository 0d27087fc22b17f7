"""Bodies of parts in the picture: where a pinhole camera sees them, before and behind the needle."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sim_hw.board.board import Board, load_board
from sim_hw.board.nest import InNest
from sim_hw.board.parts import Body
from sim_hw.plant.faults import Faults
from sim_hw.scene.scene import Scene, Shot, watch
from sim_hw.scene.sensor import Image
from tests.sim_hw.pinhole import pinhole_px
from tests.sim_hw.scene_double import FakePlant
from tests.sim_hw.small_board import write_board


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> Board:
    return load_board(write_board(tmp_path_factory.mktemp("small")))


def block(x0: float, y0: float, x1: float, y1: float, height_um: float) -> Body:
    return Body("X1", np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]), height_um, white=230, red=220)


class Bench:
    """The small board with one block on it, the tip at a place of it (mm)."""

    def __init__(self, board: Board, body: Body, tip_mm: tuple[float, float], theta_deg: float = 0.0) -> None:
        self.board, self.plant, self.faults = replace(board, bodies=(body,)), FakePlant(), Faults()
        self.scene = Scene(self.plant, self.board, self.faults, seed=11)
        x_um, y_um = board.nominal_um(*tip_mm)
        self.plant.head = replace(self.plant.head, tip_x_um=x_um, tip_y_um=y_um, theta_deg=theta_deg)

    def shoot(self) -> Image:
        return self.scene.render(Shot(1, 0.02, watch(self.plant, 0.0, 0.02)))

    def px(self, x_mm: float, y_mm: float, height_um: float) -> tuple[int, int]:
        x, y = pinhole_px(self.plant.head, (*self.board.nominal_um(x_mm, y_mm), height_um))
        return round(float(x)), round(float(y))


@pytest.mark.parametrize("theta_deg", [0.0, 250.0])
def test_the_top_of_a_body_is_seen_where_a_pinhole_camera_sees_it(bare: Board, theta_deg: float) -> None:
    turn = np.radians(theta_deg)
    aside = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ (6.0, -2.0)
    x, y = 10.0, 7.0
    bench = Bench(bare, block(x - 1.0, y - 1.0, x + 1.0, y + 1.0, 2_000.0), (x - aside[0], y - aside[1]), theta_deg)
    frame = bench.shoot().astype(int).max(axis=2)
    for dx, dy in ((-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9)):
        column, row = bench.px(x + dx, y + dy, 2_000.0)
        assert frame[row, column] > 150, "inside the top's corner"
    for dx, dy in ((-1.1, -1.1), (1.1, -1.1), (1.1, 1.1), (-1.1, 1.1)):
        column, row = bench.px(x + dx, y + dy, 2_000.0)
        assert frame[row, column] < 150, "beyond it"


def test_a_body_hides_the_needle_behind_it_and_not_the_one_before_it(bare: Board) -> None:
    tip = np.array((10.0, 7.0))
    levels = []
    for sign in (-1.0, 1.0):
        needle = Bench(bare, block(0.0, 0.0, 0.1, 0.1, 1.0), (10.0, 7.0)).scene.needle
        x, y = tip + sign * needle.away[:2]
        bench = Bench(bare, block(x - 0.5, y - 0.5, x + 0.5, y + 0.5, 6_000.0), (10.0, 7.0))
        column, row = np.array(bench.scene.tip_px(bench.plant.head)) + 150.0 * needle.up  # the needle's black marking
        levels.append(int(bench.shoot()[round(row), round(column)].max()))
    nearer, beyond = levels
    assert nearer > 80
    assert beyond < 45


def test_another_board_is_drawn_from_the_next_frame_on(bare: Board, tmp_path: Path) -> None:
    bench = Bench(bare, block(9.0, 6.0, 11.0, 8.0, 1_000.0), (4.0, 8.0))
    before = bench.shoot()
    bench.scene.put(InNest.made(bare))
    column, row = bench.px(10.0, 7.0, 1_000.0)
    assert int(before[row, column].max()) > 150 > int(bench.shoot()[row, column].max())
