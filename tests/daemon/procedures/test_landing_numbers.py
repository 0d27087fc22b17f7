"""Where the needle would come down by a look: below the image of its end, and beside the metal of the target."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from daemon.procedures.look_numbers import landing_of
from daemon.procedures.registered import Registered
from vision import TestPoint

TIP: Any = SimpleNamespace(x_px=400.0, y_px=300.0)
WAY: Any = SimpleNamespace(distance_um=123.0)
BELOW_PX = (6.0, 14.0)


def _look(board: Any = None) -> Any:
    return SimpleNamespace(board=board)


def _seen() -> TestPoint:
    return TestPoint(430.0, 310.0, 20.0, "site", (430.0, 310.0), None, 0.1, 1.0, "round", 0.5, 0.0)


def test_the_needle_comes_down_below_its_image_and_not_at_it() -> None:
    landing = landing_of(_look(), TIP, _seen(), BELOW_PX, WAY)
    assert (landing.tip_px, landing.below_px) == ((400.0, 300.0), (406.0, 314.0))
    assert (landing.target_px, landing.off_um) == ((430.0, 310.0), 123.0)


def test_a_pad_that_was_seen_is_outlined_as_the_ellipse_that_it_is() -> None:
    outline = landing_of(_look(), TIP, _seen(), BELOW_PX, WAY).outline_px
    assert outline is not None
    assert np.ptp(outline, axis=0) == pytest.approx([20.0, 40.0], abs=1.0), "the minor axis lies along x"
    assert outline.mean(axis=0) == pytest.approx([430.0, 310.0], abs=1.0)


@pytest.mark.parametrize("known", [True, False])
def test_a_registered_pad_is_outlined_by_cad_where_the_board_was_found(known: bool) -> None:
    found: Any = SimpleNamespace(shift_um=(100.0, -50.0))
    square = np.array([(0.0, 0.0), (200.0, 0.0), (200.0, 200.0), (0.0, 200.0)])
    target = SimpleNamespace(outline_um=square) if known else None
    tenth = np.diag([0.1, 0.1, 1.0])
    board = SimpleNamespace(search=SimpleNamespace(target=target), board_to_px=tenth)
    registered = Registered(25.0, 5.0, 0.1, "pad", "registered", found)
    outline = landing_of(_look(board), TIP, registered, BELOW_PX, WAY).outline_px
    if not known:
        assert outline is None
        return
    assert outline == pytest.approx(np.add(square, (100.0, -50.0)) / 10.0)
