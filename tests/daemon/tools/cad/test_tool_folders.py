"""Folders as the common tools deliver them are read as they are."""

from pathlib import Path

import pytest

from daemon.tools.cad import Cad, read_cad
from tests.daemon.tools.cad.small_board import PADS, SmallBoard, write
from tests.daemon.tools.cad.tool_folders import TOOLS


def whole(cad: Cad) -> None:
    """Check that a reading of the small board says all of it, in place."""
    board = SmallBoard()
    for side in ("top", "bottom"):
        wanted = sum(p.drill > 0 or p.side == side for p in PADS)
        assert sum(s.flashed for s in cad.layers[side, "copper"]) == wanted  # type: ignore[index]
        opened = sum((p.drill > 0 or p.side == side) and p.open for p in PADS)
        assert sum(s.flashed for s in cad.layers[side, "mask"]) == opened  # type: ignore[index]
    x0, y0, x1, y1 = cad.box_mm
    assert (x0, y0, x1, y1) == pytest.approx((50.0, 30.0, 80.0, 50.0), abs=0.06)
    holes = sorted((p.x, p.y, p.drill) for p in board.placed() if p.drill)
    holes += sorted((x + 50.0, y + 30.0, d) for x, y, d in board.holes)
    found = [(d.x_mm, d.y_mm, d.diameter_mm) for d in cad.drills]
    assert len(found) == len(holes)
    for hole in holes:
        assert any(h == pytest.approx(hole, abs=0.03) for h in found), hole
    assert cad.netlist_shift_mm == pytest.approx((0.0, 0.0), abs=0.02)
    assert {(p.part, p.pin, p.net) for p in cad.pins} == {(p.part, p.pin, p.net) for p in PADS}


@pytest.mark.parametrize("tool", TOOLS)
def test_a_folder_is_read_as_the_tool_delivers_it(tool: str, tmp_path: Path) -> None:
    cad = read_cad(write(tmp_path, TOOLS[tool]))
    whole(cad)
