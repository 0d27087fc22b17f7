"""State of the seat: whether it is known which board lies in the nest, which side up, how turned, and where.

A seat is verified by an alignment that saw places which are found nowhere else on this board. Until then only a target
may be believed whose own surroundings are such a place.
"""

from __future__ import annotations

from daemon.domain.board import BoardPoint
from daemon.domain.errors import Fault, FaultCode
from daemon.jobs.context import StationContext
from daemon.procedures.calibrate.commit import on_disk
from daemon.storage.alignment_void import Void
from daemon.storage.calibration_records import AlignmentRecord
from vision.registration import LayerShifts

MOST_ALIKE = 0.9
"""A target whose nearest rival comes less near to being taken for it may be believed without a verified seat. Places of
a seat have to be farther from any: they are what settles it, and are looked at without a target."""


def seat_record(context: StationContext) -> AlignmentRecord | None:
    """Return the alignment in force, if it verified the seat."""
    record = context.calibrations.alignment(context.board)
    return record if record is not None and record.seat is not None and record.seat.verified else None


def verified(context: StationContext) -> bool:
    """Whether the board in the nest is known for this one, this side up, unturned."""
    return seat_record(context) is not None


def seat_shifts(context: StationContext) -> LayerShifts:
    """Return by how much ink and openings of this board lie off its copper, as the alignment saw it."""
    record = seat_record(context)
    if record is None or record.seat is None:
        return LayerShifts()
    return LayerShifts(record.seat.ink_um, record.seat.openings_um)


def limit_um(context: StationContext) -> float:
    """Return how far from its nominal place a board may be seen, before it counts as lying elsewhere."""
    servo = context.servo
    return servo.trusted_um if verified(context) and context.calibrations.head is not None else servo.max_placement_um


async def void_seat(context: StationContext, why: str) -> None:
    """Believe no alignment any more, if there is a verified one: no correction is made before one passes."""
    record = seat_record(context)
    if record is not None:
        await on_disk(context.calibrations.void_alignment, Void(why, record.board_id))


async def require_unique(context: StationContext, point: BoardPoint) -> None:
    """Raise `Fault` (not_aligned) on a seat that was not verified, where another place looks like this one."""
    if verified(context):
        return
    rival = await context.references.how_unique(point.place_um)
    if rival.rival_score <= MOST_ALIKE:
        return
    raise Fault(
        FaultCode.NOT_ALIGNED,
        f"{point.name} seems to be in view, but {rival.rival} another place may be taken for it "
        f"({rival.rival_score:.2f} of what a look asks for, {MOST_ALIKE} at most): which of both it is only an "
        "alignment can tell",
        advice="send `align`; it looks at places that are found once on the board",
        test_point=point.name,
        alike=round(rival.rival_score, 3),
        rival_um=[round(v) for v in rival.rival_um],
    )
