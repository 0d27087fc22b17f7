"""A board file says what it says whole, in either format, packed or not; a broken one is refused in a sentence."""

import codecs
import gzip
import json
from pathlib import Path

import numpy as np
import pytest

from daemon.domain.board import Board, BoardPoint
from daemon.domain.board_layers import BoardLayers, Body, HoleShape, Painting, SideShapes
from daemon.domain.errors import Fault

SQUARE = (0, 0, 1000, 0, 1000, 1000, 0, 1000)
SMALL = (200, 200, 800, 200, 800, 800)
TOP = SideShapes(
    copper=Painting(outlines=(SQUARE, SMALL), removes=(1,)),
    holes=(HoleShape(x_um=500, y_um=500, diameter_um=300, end_um=(700, 500), covered=True),),
    bodies=(Body(outline=SQUARE, part="U1", height_um=900),),
)
BOARD = Board(
    name="b", side="top", width_um=2000, height_um=1000,
    points=(
        BoardPoint(name="TP1", kind="site", x_um=500, y_um=500, diameter_um=600, net="A", rank=1),
        BoardPoint(name="U1.1", kind="pad", shape="rectangle", x_um=900, y_um=500, net="A", rank=0, metal_um=(SMALL,)),
        BoardPoint(name="J1.1", kind="pin", shape="ring", x_um=1500, y_um=900, centre_um=(1500, 500), diameter_um=640),
    ),
    layers=BoardLayers(top=TOP, bottom=SideShapes()),
)  # fmt: skip
OLD = {
    "format": "reprobe-board-1", "name": "b", "side": "top", "width_um": 1000.0, "height_um": 1000.0, "hidden": {},
    "points": [{"name": "TP1", "kind": "via", "x_um": 1.5, "y_um": 2.0, "diameter_um": 160.0, "hole_um": None,
                "net": None, "why_not": None}],
}  # fmt: skip


@pytest.mark.parametrize("name", ["board.json", "board.json.gz"])
def test_a_board_file_is_read_as_it_was_written(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    BOARD.save(path)
    assert (path.read_bytes()[:2] == b"\x1f\x8b") is name.endswith(".gz")
    assert Board.load(path) == BOARD
    assert Board.load(path).revision == BOARD.revision


def test_a_packed_file_is_known_by_its_content_whatever_it_is_called(tmp_path: Path) -> None:
    BOARD.save(tmp_path / "board.json.gz")
    renamed = (tmp_path / "board.json.gz").rename(tmp_path / "board.json")
    assert Board.load(renamed) == BOARD


@pytest.mark.parametrize("pack", [bytes, gzip.compress])
def test_a_byte_order_mark_is_no_fault(tmp_path: Path, pack: type[bytes]) -> None:
    path = tmp_path / "board.json"
    path.write_bytes(pack(codecs.BOM_UTF8 + json.dumps(OLD).encode()))
    assert Board.load(path).points[0].name == "TP1"


def test_an_old_file_is_read_and_says_that_a_new_one_serves_more(tmp_path: Path) -> None:
    path = tmp_path / "board.json"
    path.write_text(json.dumps(OLD))
    board = Board.load(path)
    assert board.side_layers("top") is None
    assert board.point("TP1").stands_round
    with pytest.raises(Fault, match=r"no test point U1\.3; this board file has no layers: make it again"):
        board.point("U1.3")


def test_the_layers_of_a_side_come_as_arrays_in_painting_order() -> None:
    layers = BOARD.side_layers("top")
    assert layers is not None
    assert [polygon.dark for polygon in layers.copper] == [True, False]
    assert np.array_equal(layers.copper[1].points_um, [(200, 200), (800, 200), (800, 800)])
    hole = layers.holes[0]
    assert (hole.end_x_um, hole.end_y_um, hole.covered, hole.plated) == (700, 500, True, True)
    assert len(layers.bodies) == 1
    assert BOARD.side_layers("bottom") is not None


def _whole() -> dict[str, object]:
    return {"format": BOARD.format, **BOARD.model_dump(mode="json")}


def _broken(**layer: object) -> bytes:
    facts = _whole()
    facts["layers"]["top"]["copper"] = layer  # type: ignore[index]
    return json.dumps(facts).encode()


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"", "not a board file"),
        (b"\x1f\x8b\x08garbage", "packed, and broken"),
        (gzip.compress(json.dumps(OLD).encode())[:-20], "its end is missing"),
        (_broken(outlines=[[0, 0, 1, 1, 2]]), r"layers\.top\.copper\.outlines\.0: .*5 numbers"),
        (_broken(outlines=[[0, 0, 1, 1]]), "4 numbers"),
        (_broken(outlines=[[0, 0, 1, 1, 2, 9_000_000]]), "less than or equal"),
        (_broken(outlines=[], removes=[0]), "removes names an outline that is not there"),
        (b"[" * 100_000, "not a board file"),
    ],
)
def test_a_broken_file_is_refused_in_a_sentence(tmp_path: Path, content: bytes, complaint: str) -> None:
    path = tmp_path / "board.json"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=complaint) as caught:
        Board.load(path)
    assert "reprobe board" in str(caught.value)
    assert len(str(caught.value)) < 400


def test_a_small_file_that_unpacks_to_gigabytes_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("daemon.domain.board_file.MOST_BYTES", 10_000)
    path = tmp_path / "board.json.gz"
    path.write_bytes(gzip.compress(b" " * 20_000))
    with pytest.raises(ValueError, match="more than 10000 bytes"):
        Board.load(path)


def test_the_points_of_a_net_come_best_first() -> None:
    assert [p.name for p in BOARD.of_net("A")] == ["U1.1", "TP1"]


def test_what_does_not_stand_round_is_never_looked_for_by_a_round_outline() -> None:
    assert [p.name for p in BOARD.round_points()] == ["TP1"]
    with pytest.raises(Fault, match=r"U1\.1 is not round"):
        BOARD.round_point("U1.1")
    with pytest.raises(Fault, match=r"J1\.1 is touched beside its middle"):
        BOARD.round_point("J1.1")


def test_a_ring_counts_as_a_lookalike_by_its_middle() -> None:
    places = BOARD.lookalikes_um(BOARD.find("TP1"), within_um=1100.0)
    assert places.tolist() == [[500, 500], [1500, 500]]


def test_a_file_that_an_editor_began_with_a_byte_order_mark_is_read(tmp_path: Path) -> None:
    board = Board(name="b", side="top", width_um=1000.0, height_um=1000.0, points=())
    board.save(tmp_path / "board.json")
    plain = (tmp_path / "board.json").read_bytes()
    (tmp_path / "board.json").write_bytes(b"\xef\xbb\xbf" + plain)
    assert Board.load(tmp_path / "board.json") == board
