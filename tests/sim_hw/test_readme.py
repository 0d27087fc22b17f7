"""The README names every fault and every knob of the board."""

from pathlib import Path

import pytest

import sim_hw
from sim_hw.plant.faults import DEFAULTS
from sim_hw.plant.knobs import Knobs

TEXT = (Path(sim_hw.__file__).parent / "README.md").read_text()
MADE = [name for name in Knobs.names() if name.startswith(("board_ink", "board_openings", "board_dirt", "board_marks"))]


@pytest.mark.parametrize("name", [*DEFAULTS, "board_mask", "board_metal", "board_oxide", *MADE])
def test_it_is_in_the_readme(name: str) -> None:
    pair = name.replace("_dy_um", "_dx_um")  # a pair of shifts is one row
    assert f"`{pair}`" in TEXT
