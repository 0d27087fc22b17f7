"""Clearance: the lowest height at which the head may go sideways over this board, as it lies and as far as is known.

It answers for a way, and says nothing (None) where anything that it goes by is in doubt: the board's file, its surface
along the way, whether the board in the nest is the one that was measured, where it lies, where the tip is. The head
then goes at the safe height, which is free of everything.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from daemon.config.model import Config
from daemon.config.sections.motion import ClearanceSection
from daemon.domain.board import Board
from daemon.station.board_trust import BoardTrust
from daemon.station.clearance_map import ClearanceMap
from daemon.station.free_pin import FLEX_WITHIN_UM
from daemon.station.kinematics import Geometry
from daemon.station.swept_area import NEEDLE, swept_areas_um
from daemon.storage.calibration_store import Calibrations
from drivers.gantry import ClearHeight, Position
from vision.geometry import Array

LEAST_LOOK_UM = 10.0
"""No alignment knows where its targets were better than this."""
SIGMAS = 3.0
UNALIGNED_DEG = 3.0
"""A board that no alignment has seen is turned by no more than this, or looks are refused there."""


@dataclass(frozen=True)
class SeatDoubt:
    """How far off where it is taken to be a place of the board may lie: so much, and more the farther from a middle."""

    beside_um: float
    turn_rad: float
    about_um: tuple[float, float] | None = None
    """Middle of the targets that told, robot frame; None: what was seen was below the needle."""

    def reach_um(self, area_um: Array, tip_um: Array) -> float:
        """Return by how much an area (N, 2) in the robot frame is to be grown."""
        about = tip_um if self.about_um is None else np.array(self.about_um)
        return self.beside_um + math.tan(self.turn_rad) * float(np.hypot(*(area_um - about).T).max())


@dataclass(frozen=True)
class HeadPart:
    """A part of the head: how high above the needle's end it begins, its corners about the needle, its radius."""

    from_um: float
    corners_um: Iterable[tuple[float, float]]
    radius_um: float


def head_parts(section: ClearanceSection) -> tuple[HeadPart, ...]:
    """Return needle, barrel and the rest of the head."""
    x0, y0, x1, y1 = section.head_box_um
    return (
        HeadPart(0.0, NEEDLE, section.needle_radius_um),
        HeadPart(section.barrel_from_um, NEEDLE, section.barrel_radius_um),
        HeadPart(section.head_from_um, ((x0, y0), (x1, y0), (x1, y1), (x0, y1)), 0.0),
    )


class Clearance:
    """Of one board on one station; it looks at the calibrations whenever it is asked."""

    def __init__(
        self, config: Config, board: Board, calibrations: Calibrations, geometry: Geometry, trust: BoardTrust
    ) -> None:
        self._section, self._gantry, self._servo = config.clearance, config.gantry, config.servo
        self._board, self._calibrations, self._geometry, self._trust = board, calibrations, geometry, trust

        self._map: ClearanceMap | None = None

    async def by_calibration(self) -> ClearHeight:
        """Return who answers for a way by calibration alone, which ends within what can be corrected."""
        await self._prepare()
        return lambda places: self._clear_um(places, self._seat_doubt())

    async def as_seen(self, shift_um: tuple[float, float]) -> ClearHeight:
        """Return who answers for a short way from where a look has just seen the board below the needle.

        shift_um: how far from its place by calibration the target was seen.
        """
        await self._prepare()
        doubt = SeatDoubt(math.hypot(*shift_um) + self._servo.trusted_um, math.radians(UNALIGNED_DEG))
        return lambda places: self._clear_um(places, doubt)

    async def _prepare(self) -> None:
        """Make the map of this board, once; that takes up to a tenth of a second."""
        if self._map is None and self._section is not None:
            self._map = await asyncio.to_thread(ClearanceMap, self._board, self._section)

    def _seat_doubt(self) -> SeatDoubt | None:
        """Return how well calibrations tell where the tip is over the board; None: not well enough."""
        record = self._calibrations.alignment(self._board)
        if record is None or record.seat is None or not record.seat.verified or self._calibrations.head is None:
            return None
        seen = np.array([target.robot_um for target in record.fiducials], dtype=float).reshape(-1, 2)
        if len(seen) < 2:
            return None
        about = seen.mean(axis=0)
        spread_um = math.sqrt(float(((seen - about) ** 2).sum()))
        turn = SIGMAS * max(record.rms_um, LEAST_LOOK_UM) / max(spread_um, 1.0)
        if not turn < math.radians(UNALIGNED_DEG):
            return None
        # Any way may end beside its place by as much as can be corrected
        return SeatDoubt(self._servo.max_placement_um, turn, (float(about[0]), float(about[1])))

    def _clear_um(self, places: Sequence[Position], doubt: SeatDoubt | None) -> float | None:
        """Return the lowest clear Z of a way, at most the safe height; None where it is not known."""
        if self._map is None or self._section is None or doubt is None or not self._board_is_sure:
            return None
        # Where a look showed the pin free it may be pushed in by what the stops' flex hides
        lowest_um = min(places[0].z_um + FLEX_WITHIN_UM, self._gantry.free_z_um)
        for part in head_parts(self._section):
            if self._gantry.safe_z_um - part.from_um <= lowest_um:
                continue  # what hangs so high is free of everything there
            need_um = self._part_z_um(part, places, doubt, self._section.clear_um, self._map)
            if need_um is None:
                return None
            lowest_um = max(lowest_um, need_um)
        return lowest_um

    @property
    def _board_is_sure(self) -> bool:
        """Whether a look has just shown that the board which was measured lies there, and that the pin is free."""
        return self._calibrations.probe is not None and self._trust.is_recognised

    def _part_z_um(
        self,
        part: HeadPart,
        places: Sequence[Position],
        doubt: SeatDoubt,
        clear_um: float,
        board: ClearanceMap,
    ) -> float | None:
        """Return the lowest Z at which a part of the head passes; None where the surface is not measured."""
        head = self._geometry.head
        tip_um = self._geometry.tip_um(places[0])
        lowest_um = -math.inf
        for area in swept_areas_um(places, head, part.corners_um):
            surface_um = self._surface_um(area) if part.from_um == 0.0 else self._plane_um(area)
            if surface_um is None:
                return None
            on_board = self._geometry.robot_to_board_um(area)
            reach_um = part.radius_um + doubt.reach_um(area, tip_um)
            on_it_um = self._gantry.touch_z_um + surface_um + board.height_um(on_board, reach_um)
            # Reference pad and brush may stand higher than all else beside the board
            top_um = max(on_it_um, self._geometry.highest_pad_z_um(area, reach_um)) + clear_um
            # What is not known is free at the safe height
            lowest_um = max(lowest_um, min(top_um, self._gantry.safe_z_um) - part.from_um)
        return lowest_um

    def _surface_um(self, area_um: Array) -> float | None:
        """Return how high the board's surface is at most below an area; None where it is not measured all over."""
        heights = [self._geometry.measured_um(place) for place in area_um]
        known = [height for height in heights if height is not None]
        return max(known) if len(known) == len(heights) else None

    def _plane_um(self, area_um: Array) -> float:
        """Return how high the measured plane is at most below an area, and beyond where it was measured."""
        return max(self._geometry.height_um(place) for place in area_um)
