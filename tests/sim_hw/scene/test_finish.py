"""How a board was made and what became of it, in the picture; without any of it the picture is what it always was."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from sim_hw.board.board import Board, load_board
from sim_hw.board.finish import Finish
from sim_hw.board.nest import InNest, Mark
from sim_hw.plant.faults import Faults
from sim_hw.scene.scene import Scene, Shot, watch
from sim_hw.scene.sensor import Image
from sim_hw.scene.texture import BoardTexture
from tests.sim_hw.scene_double import DEMO, FakeKnobs, FakePlant, FakePose
from tests.sim_hw.small_board import RectPad, write_board

DATA = Path(__file__).parent / "data"


@pytest.fixture(scope="module")
def board(tmp_path_factory: pytest.TempPathFactory) -> Board:
    return load_board(write_board(tmp_path_factory.mktemp("small")))


def texture(board: Board, marks: list[Mark] | None = None, **finish: object) -> BoardTexture:
    return BoardTexture(board, 4, replace(Finish(), **finish), [] if marks is None else marks)  # type: ignore[arg-type]


def patch(drawn: BoardTexture, board: Board, x_mm: float, y_mm: float, half: int = 6) -> Image:
    """Return the texels about a CAD place, all four planes."""
    u_mm = x_mm - board.outline_mm[0]
    x, y, _ = drawn.from_mm(board) @ (u_mm, y_mm - board.outline_mm[1], 1.0)
    column, row = round(float(x)), round(float(y))
    drawn.ensure(column - half, row - half, column + half + 1, row + half + 1)
    return drawn.image[row - half : row + half + 1, column - half : column + half + 1]


@pytest.mark.parametrize(("side", "name"), [("top", "TP6"), ("bottom", "TP10")])
@pytest.mark.parametrize("light", ["white", "red"])
def test_a_bare_board_without_a_flaw_looks_as_it_always_did(side: str, name: str, light: str) -> None:
    demo, plant = load_board(DEMO, side), FakePlant()
    scene = Scene(plant, demo, Faults(), 11)
    plant.knobs, plant.board_pose = FakeKnobs(camera_noise_grey=0.0), FakePose(dx_um=40.0, rotation_deg=0.3)
    on = {"white": float(light == "white"), "red": float(light == "red")}
    plant.aim(demo, name, dx_um=-300.0, dy_um=200.0, theta_deg=30.0, **on)
    frame = scene.render(Shot(3, 0.02, watch(plant, 0.0, 0.02)))[520:700, 360:620]
    kept = cv2.imread(str(DATA / f"{side}-{name}-{light}.png"))
    assert kept is not None
    away = np.abs(frame.astype(int) - kept)
    # Other processors may round a Fourier transform otherwise: a grey level here and there.
    assert away.max() <= 2
    assert away.mean() < 0.01


@pytest.mark.parametrize(
    ("mask", "strongest"), [("green", (1,)), ("red", (2,)), ("blue", (0,)), ("black", (0, 1, 2)), ("white", (0, 1, 2))]
)
def test_the_mask_has_its_colour_and_metal_shines_on_it(board: Board, mask: str, strongest: tuple[int, ...]) -> None:
    drawn = texture(board, mask=mask)
    covered = patch(drawn, board, 6.0, 6.0).reshape(-1, 4).mean(axis=0)
    metal = patch(drawn, board, 9.5, 5.0).reshape(-1, 4).mean(axis=0)
    assert int(np.argmax(covered[:3])) in strongest
    assert (covered[:3].min() > 130) == (mask == "white")
    if mask != "white":
        assert metal[:3].sum() > 2.0 * covered[:3].sum()


def test_openings_and_ink_lie_off_the_copper_by_their_shifts() -> None:
    demo = load_board(DEMO)
    plain, shifted = texture(demo), texture(demo, mask_shift_um=(90.0, 0.0), ink_shift_um=(0.0, 180.0))
    target = demo.target("TP5")
    edge_mm = target.pad_diameter_mm / 2.0
    inside = [patch(t, demo, target.x_mm - edge_mm + 0.04, target.y_mm, 2)[..., 3].mean() for t in (plain, shifted)]
    assert inside[0] > 120 > 80 > inside[1], "the left rim of the pad is now under mask"
    ink = next(shape for shape in demo.layers.silk if shape.box_mm[2] - shape.box_mm[0] > 0.8)
    x_mm, y_mm = (ink.box_mm[0] + ink.box_mm[2]) / 2.0, (ink.box_mm[1] + ink.box_mm[3]) / 2.0
    assert np.array_equal(patch(plain, demo, x_mm, y_mm, 3) > 90, patch(shifted, demo, x_mm, y_mm + 0.18, 3) > 90)
    assert not np.array_equal(patch(plain, demo, x_mm, y_mm, 20) > 90, patch(shifted, demo, x_mm, y_mm, 20) > 90)


def test_the_bottoms_layers_shift_as_they_are_seen() -> None:
    below = load_board(DEMO, "bottom")
    target = below.target("TP10")
    shifted = InNest.made(below, Finish(mask_shift_um=(60.0, 0.0))).surface
    seen_right_mm = 0.05  # seen from below, right is towards smaller CAD x
    assert shifted.at(target.x_mm - seen_right_mm, target.y_mm).what == "metal"
    assert shifted.at(target.x_mm + seen_right_mm, target.y_mm).what == "mask"


def test_molten_tin_is_uneven_over_a_pad_and_the_mask_is_as_before(board: Board) -> None:
    gold, tin = texture(board), texture(board, metal="hasl")
    assert patch(tin, board, 9.5, 5.0, 60)[..., 1].std() > 2.5 * patch(gold, board, 9.5, 5.0, 60)[..., 1].std()
    assert np.array_equal(patch(tin, board, 6.0, 6.0, 20), patch(gold, board, 6.0, 6.0, 20))


def test_domes_go_on_over_the_borders_of_tiles(tmp_path: Path) -> None:
    # texel 1024 of the columns lies at 1024 * 6 um - 1 mm = 5.144 mm
    wide = load_board(write_board(tmp_path, [RectPad("U1", "1", "A", 5.144, 5.0, 2.0, 2.0)]))
    drawn = texture(wide, metal="hasl")
    seam = patch(drawn, wide, 5.144, 5.0, 100)[..., 1].astype(int)
    steps = np.abs(np.diff(seam, axis=1)).mean(axis=0)
    assert steps[95:105].max() < 1.6 * np.percentile(steps, 95)


def test_tarnish_darkens_metal_alone(board: Board) -> None:
    clean, old = texture(board), texture(board, oxide=0.8)
    assert patch(old, board, 9.5, 5.0, 60).mean() < 0.8 * patch(clean, board, 9.5, 5.0, 60).mean()
    assert np.array_equal(patch(old, board, 6.0, 6.0, 20), patch(clean, board, 6.0, 6.0, 20))


def test_dirt_is_as_many_spots_of_all_sizes(board: Board) -> None:
    clean, dirty = texture(board), texture(board, dirt_per_cm2=30.0)
    for drawn in (clean, dirty):
        drawn.ensure(0, 0, drawn.width, drawn.height)
    changed = (np.abs(clean.image.astype(int) - dirty.image).max(axis=2) > 12).astype(np.uint8)
    _, _, stats, _ = cv2.connectedComponentsWithStats(changed)
    across_um = np.sqrt(stats[1:, cv2.CC_STAT_AREA] * 4.0 / np.pi) * 6.0
    expected = 30.0 * (20.0 + 2.0) * (15.0 + 2.0) / 100.0
    assert 0.5 * expected < (across_um > 20.0).sum() <= 1.1 * expected
    assert (across_um > 400.0).any()
    assert (across_um < 120.0).any()


def test_a_dent_stays_where_the_needle_was(board: Board) -> None:
    marks: list[Mark] = []
    drawn = texture(board, marks)
    before = patch(drawn, board, 9.5, 5.0, 12).copy()
    far = patch(drawn, board, 3.0, 3.0, 6).copy()
    marks.append(Mark(9.5, 5.0, 30.0))
    after = patch(drawn, board, 9.5, 5.0, 12)
    assert int(after[10:15, 10:15].mean()) < 0.6 * int(before[10:15, 10:15].mean())
    assert np.array_equal(after[0], before[0]), "beyond the dent nothing changes"
    assert np.array_equal(patch(drawn, board, 3.0, 3.0, 6), far)


class Bench:
    """The small board, seen."""

    def __init__(self, board: Board) -> None:
        self.board, self.plant, self.faults = board, FakePlant(), Faults()
        self.scene = Scene(self.plant, board, self.faults, seed=11)
        x_um, y_um = board.nominal_um(10.0, 7.0)
        self.plant.head = replace(self.plant.head, tip_x_um=x_um, tip_y_um=y_um)

    def shoot(self, sequence: int = 1) -> Image:
        return self.scene.render(Shot(sequence, 0.02, watch(self.plant, 0.0, 0.02)))


def test_a_board_that_is_gone_leaves_grey_metal_below(board: Board) -> None:
    bench = Bench(board)
    before = bench.shoot()
    bench.faults.switch("board_gone", on=True)
    frame = bench.shoot()[700:, 700:].astype(float)
    assert 25.0 < frame.mean() < 90.0
    assert np.ptp(frame.mean(axis=(0, 1))) < 6.0, "neutral"
    assert 1.0 < cv2.GaussianBlur(frame, (0, 0), 2.0).std() < 12.0
    bench.faults.switch("board_gone", on=False)
    assert np.array_equal(bench.shoot(), before)


def test_a_glint_blinds_the_camera_on_the_pad_under_the_tip(board: Board) -> None:
    bench = Bench(board)
    x_um, y_um = board.nominal_um(9.5, 5.0)
    bench.plant.head = replace(bench.plant.head, tip_x_um=x_um, tip_y_um=y_um + 300.0)
    plain = bench.shoot()
    bench.faults.switch("glint", on=True, px=6.0)
    places = []
    for sequence in (1, 2):
        frame = bench.shoot(sequence)
        rows, columns = np.nonzero((frame.min(axis=2) > 235) & (plain.min(axis=2) < 235))
        assert len(rows) > 30
        places.append((columns.mean(), rows.mean()))
        assert places[-1] == pytest.approx(bench.scene.board_px(bench.plant.head, 9.5, 5.0), abs=16.0)
    assert places[0] != pytest.approx(places[1], abs=0.5), "it wanders"
