"""What is drawn of a board is kept while it is wanted, and given up at rest."""

from __future__ import annotations

from daemon.station.board_references import BoardReferences
from tests.daemon.procedures.cad_board import cad_board, cad_pad
from vision.registration import LayerShifts

PLACE = (15_000.0, 12_000.0)
BOARD = cad_board(cad_pad("R1.1", *PLACE), cad_pad("R1.2", 30_000.0, 20_000.0))


async def test_what_was_drawn_is_given_up_and_drawn_again_alike() -> None:
    """It should keep what it found out of places, which costs more than drawing."""
    references = BoardReferences(BOARD)
    drawn, whole = await references.about(PLACE, LayerShifts()), references.sides.whole()
    assert await references.about(PLACE, LayerShifts()) is drawn
    assert references.sides.whole() is whole
    rival = await references.how_unique(PLACE)
    references.forget()
    again = await references.about(PLACE, LayerShifts())
    assert again is not drawn
    assert (again.wide.planes.cover == drawn.wide.planes.cover).all()
    assert references.sides.whole() is not whole
    assert await references.how_unique(PLACE) is rival


async def test_what_is_being_drawn_is_not_given_up() -> None:
    """It should let who waits for it have it, and not have it drawn twice."""
    references = BoardReferences(BOARD)
    under_way = references.begin(PLACE, LayerShifts())
    references.forget()
    assert references.begin(PLACE, LayerShifts()) is under_way
    await under_way
