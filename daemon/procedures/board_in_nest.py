"""The board in the nest: whether it is the one that was aligned.

A client that names another board says that boards were changed: from then on the old alignment is void, for every
client and after a restart, until an `align` passes.
"""

from __future__ import annotations

from daemon.domain.errors import Fault, FaultCode
from daemon.jobs.context import StationContext
from daemon.procedures.calibrate.commit import on_disk
from daemon.storage.alignment_void import Void


async def require_board(context: StationContext, board_id: str | None) -> None:
    """Raise `Fault` (not_aligned) if this board, or any if none is named, has to be aligned first."""
    calibrations = context.calibrations
    try:
        calibrations.require_board(context.board, board_id)
    except Fault as unaligned:
        void = calibrations.in_force.void
        known = None if void is None else void.board_id
        # Another name than the one that is known: boards were changed once more
        changed = void is None or (None not in (board_id, known) and board_id != known)
        if unaligned.kind is FaultCode.NOT_ALIGNED and changed:
            why = f"board {board_id} was put into the nest and has not been aligned"
            await on_disk(calibrations.void_alignment, Void(why, board_id))
        raise
