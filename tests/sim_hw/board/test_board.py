import itertools
import math
import re
import shutil
from pathlib import Path

import pytest

from sim_hw.board import demo_layout as lay
from sim_hw.board.board import Board, load_board, netlist_offset_mm
from sim_hw.board.make_demo_board import board_files, main
from sim_hw.board.netlist import read_netlist
from sim_hw.board.roles import ROLES_FILE
from sim_hw.board.shapes import Round
from tests.sim_hw.scene_double import DEMO, SHARED_BOARDS

# folder, side, how many round test points are bare on that side, size in mm
BOARDS = [(DEMO, "top", 12, (40.0, 30.0)), (DEMO, "bottom", 3, (40.0, 30.0))]
if (SHARED_BOARDS / "glasgow-revC3").is_dir():
    GLASGOW = SHARED_BOARDS / "glasgow-revC3"
    BOARDS += [(GLASGOW, "top", 7, (80.0, 49.0)), (GLASGOW, "bottom", 12, (80.0, 49.0))]
if (SHARED_BOARDS / "pico-ice-rev1").is_dir():
    BOARDS.append((SHARED_BOARDS / "pico-ice-rev1", "top", 0, (22.86, 60.96)))
if (SHARED_BOARDS / "open-motion-light").is_dir():
    BOARDS.append((SHARED_BOARDS / "open-motion-light", "bottom", 0, (80.0, 80.0)))


@pytest.fixture(scope="module")
def demo() -> Board:
    return load_board(DEMO, "top")


@pytest.mark.parametrize(("folder", "side", "test_points", "size_mm"), BOARDS, ids=lambda v: getattr(v, "name", str(v)))
def test_reads_a_board(folder: Path, side: str, test_points: int, size_mm: tuple[float, float]) -> None:
    board = load_board(folder, side)
    assert sum(target.name.startswith("TP") for target in board.targets) == test_points
    assert board.size_mm == pytest.approx(size_mm, abs=0.002)
    assert len({target.name for target in board.targets}) == len(board.targets)
    assert board.layers.copper
    assert board.layers.mask
    assert board.layers.outline


def test_finds_every_demo_test_point_where_the_layout_put_it(demo: Board) -> None:
    for planned in lay.TEST_POINTS:
        target = demo.target(planned.name)
        assert (target.x_mm, target.y_mm) == pytest.approx(
            (planned.centre_mm[0] + lay.ORIGIN_MM[0], planned.centre_mm[1] + lay.ORIGIN_MM[1]), abs=1e-6
        )
        assert target.pad_diameter_mm == pytest.approx(planned.pad_mm)
        assert target.net == planned.net
        assert target.kind == ("via" if planned.pad_mm < 0.3 else "site")
        assert target.probeable


def test_a_filled_and_capped_via_shows_no_hole(demo: Board) -> None:
    holes = {name: demo.target(name).hole_diameter_mm for name in ("TP1", "TP2", "TP4", "TP5", "TP11")}
    assert holes == {"TP1": 0.05, "TP2": None, "TP4": 0.12, "TP5": None, "TP11": None}


def test_tented_vias_and_fiducials_are_never_offered(demo: Board) -> None:
    places = {(round(t.x_mm - 10.0, 3), round(t.y_mm - 10.0, 3)) for t in demo.targets}
    assert not places & set(lay.TENTED)
    fiducials = [t for t in demo.targets if t.kind == "fiducial"]
    assert sorted(t.name for t in fiducials) == ["FID1", "FID2", "FID3"]
    assert not any(t.probeable for t in fiducials)


def test_the_bottom_shows_only_what_the_mask_leaves_open_there() -> None:
    bottom = load_board(DEMO, "bottom")
    assert {t.name for t in bottom.targets if t.name.startswith("TP")} == {"TP1", "TP3", "TP10"}


def test_the_bottom_is_turned_over_about_its_vertical_axis(demo: Board) -> None:
    bottom = load_board(DEMO, "bottom")
    top_x_um, top_y_um = demo.nominal_um(18.0, 35.0)
    bottom_x_um, bottom_y_um = bottom.nominal_um(18.0, 35.0)
    assert (top_x_um, top_y_um) == pytest.approx((68_000.0, 65_000.0))
    assert (bottom_x_um, bottom_y_um) == pytest.approx((92_000.0, 65_000.0))


def test_test_points_keep_their_distance_but_for_the_deliberate_neighbours(demo: Board) -> None:
    close = set()
    for one, other in itertools.combinations(demo.targets, 2):
        away_mm = math.dist((one.x_mm, one.y_mm), (other.x_mm, other.y_mm))
        if away_mm < 1.3 and any(t.name.startswith("TP") for t in (one, other)):
            close.add((round(away_mm, 3), *sorted(re.sub(r"VIA\d+", "VIA", t.name) for t in (one, other))))
    assert close == {(0.45, "TP6", "TP7"), (0.9, "TP12", "VIA")}


def test_the_free_area_is_free(demo: Board) -> None:
    x0, y0, x1, y1 = (edge + 10.0 for edge in lay.FREE_AREA_MM)
    assert x1 - x0 >= 4.0
    assert y1 - y0 >= 4.0
    for shape in demo.layers.copper + demo.layers.silk + demo.layers.mask:
        a0, b0, a1, b1 = shape.box_mm
        assert a1 < x0 or a0 > x1 or b1 < y0 or b0 > y1


def test_silkscreen_never_touches_a_test_point(demo: Board) -> None:
    for target in demo.targets:
        for shape in demo.layers.silk:
            away = shape.outline_mm - (target.x_mm, target.y_mm)
            assert float((away**2).sum(axis=1).min()) ** 0.5 > target.pad_diameter_mm / 2 + 0.05


def test_the_kept_files_are_what_the_script_writes(tmp_path: Path) -> None:
    main(tmp_path)
    kept = {p.name for p in DEMO.iterdir()} - {ROLES_FILE}  # it is written by whoever has read the folder
    assert {p.name for p in tmp_path.iterdir()} == kept
    for name, text in board_files().items():
        assert (DEMO / name).read_text() == text


def test_a_netlist_with_another_origin_is_moved_onto_the_gerbers(tmp_path: Path, demo: Board) -> None:
    folder = shutil.copytree(DEMO, tmp_path / "moved")
    path = folder / "demo.d356"

    def shifted(match: re.Match[str]) -> str:
        return f"X{int(match[1]) - 12_340:+07d}Y{int(match[2]) + 7_210:+07d}"

    path.write_text(re.sub(r"X([+-]\d{6})Y([+-]\d{6})", shifted, path.read_text()))
    moved = load_board(folder, "top")
    assert moved.netlist_offset_mm == pytest.approx((12.34, -7.21), abs=0.003)
    assert moved.targets == demo.targets


def test_no_drill_hit_means_no_offset() -> None:
    records = read_netlist(DEMO / "demo.d356")
    assert netlist_offset_mm(records, []) == (0.0, 0.0)
    assert netlist_offset_mm(records, [Round(1.0, 1.0, 9.9)]) == (0.0, 0.0)


@pytest.mark.parametrize(("tail", "mask"), [("R000S3", 3), ("R000 S3", 3), ("R000S0", 0), ("R090 S2", 2), ("R000", 0)])
def test_reads_both_spellings_of_the_mask_code(tmp_path: Path, tail: str, mask: int) -> None:
    line = f"317GND              VIA        MD0118PA00X+010787Y-005236X0236Y0000{tail}"
    (tmp_path / "n.ipc").write_text(f"P  UNITS CUST 0\n{line}\n")
    (record,) = read_netlist(tmp_path / "n.ipc")
    assert record.mask == mask
    assert (record.x_mm, record.y_mm) == pytest.approx((27.39898, -13.29944))
    assert record.hole_mm == pytest.approx(0.29972)
    assert record.is_via


def test_a_broken_record_is_named(tmp_path: Path) -> None:
    (tmp_path / "n.ipc").write_text("317GND              VIA        MD01x8PA00X+010787Y-005236X0236Y0000R000S3\n")
    with pytest.raises(ValueError, match=r"n\.ipc:1"):
        read_netlist(tmp_path / "n.ipc")


def test_files_without_a_known_name_are_told_apart_by_their_attributes(tmp_path: Path, demo: Board) -> None:
    odd = {"gtl": "a1", "gbl": "a2", "gts": "a3", "gbs": "a4", "gto": "a5", "gbo": "a6", "gm1": "a7"}
    for path in DEMO.iterdir():
        suffix = odd.get(path.suffix[1:])
        shutil.copy(path, tmp_path / (f"plot.{suffix}" if suffix else path.name))
    assert load_board(tmp_path, "top").targets == demo.targets


def test_slots_in_the_short_notation_do_not_stop_the_reader(tmp_path: Path, demo: Board) -> None:
    folder = shutil.copytree(DEMO, tmp_path / "slots")
    path = folder / "demo-PTH.drl"
    path.write_text(path.read_text().replace("M30", "X15.000Y12.000G85X16.000Y12.000\nM30"))
    board = load_board(folder, "top")
    assert board.targets == demo.targets
    assert len(board.layers.holes) == len(demo.layers.holes) + 1


def test_a_missing_layer_or_folder_is_named(tmp_path: Path) -> None:
    folder = shutil.copytree(DEMO, tmp_path / "less")
    (folder / "demo-F_Mask.gts").unlink()
    with pytest.raises(ValueError, match="top mask"):
        load_board(folder, "top")
    with pytest.raises(ValueError, match="no board folder"):
        load_board(tmp_path / "nowhere", "top")
    with pytest.raises(ValueError, match="'left'"):
        load_board(DEMO, "left")
