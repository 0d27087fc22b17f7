"""Campaign: one random place and one correction after the other on a board with parts, each judged by the plant."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from random import Random

import numpy as np

from daemon.config.sections.motion import ClearanceSection
from daemon.domain.board import Board, BoardPoint
from drivers.errors import EnvelopeViolation
from drivers.gantry import ClearHeight, Position, axis_theta_deg
from drivers.gantry.path import Leg, plan
from sim_hw.board.board import Board as RealBoard
from sim_hw.board.parts import Bodies
from sim_hw.plant.faults import Faults
from sim_hw.plant.knobs import Knobs
from sim_hw.plant.plant import Placement, Plant
from sim_hw.scene.collision import Hit
from sim_hw.scene.needle import Needle
from sim_hw.scene.optics import make_optics
from tests.bench.clearance.drive import Drive
from tests.bench.clearance.known import Known

PLACES_A_SEAT = 100
FAR_SHARE, NEIGHBOURS = 0.4, 15
FEWEST_POINTS = 5
TURNED_SHARE = 0.3
"""Of places come with another head angle."""
CORRECTED_UM = 60.0
"""Spread of the error of which a correction is made where the place itself has ended nearer."""
PLANT_KNOBS = {"misplaced_share": 0.1, "misplaced_um": 400.0}
FIGURES = {"needle_radius_um": 260.0, "barrel_from_um": 9_200.0, "barrel_radius_um": 420.0, "outline_um": 2_500.0}
"""As measured off the simulated needle and parts, a little more: no body reaches 2 mm beyond what its pads tell."""


@dataclass
class Tally:
    """What came of a campaign."""

    places: int = 0
    corrections: int = 0
    hits: list[Hit] = field(default_factory=list)
    left_out: int = 0
    """Places where the head cannot even stand, part or no part beside the pad: not the way's fault."""
    rises_um: dict[str, list[float]] = field(default_factory=lambda: {"place": [], "correct": []})
    """How high above the nominal surface each way went across."""


@dataclass(frozen=True)
class Case:
    """One board, as it stands and as its file tells, and how low the head hangs."""

    name: str
    real: RealBoard
    told: Board
    section: ClearanceSection
    head_from_um: float


async def run(case: Case, places: int, seed: int, folder: Path, say: Callable[[Tally], None]) -> Tally:
    """Make so many places, each with a correction after it."""
    campaign = _Campaign(case, seed, folder)
    while campaign.tally.places < places and campaign.has_points:
        if campaign.tally.places % PLACES_A_SEAT == 0:
            campaign.seat()
            say(campaign.tally)
        await campaign.one()
    return campaign.tally


class _Campaign:
    def __init__(self, case: Case, seed: int, folder: Path) -> None:
        self._case, self._chance = case, Random(f"{seed}/{case.name}/{case.head_from_um}")
        knobs = replace(Knobs(), head_from_um=case.head_from_um, z_start_um=12_000.0)
        for name, value in PLANT_KNOBS.items():
            knobs = knobs.with_value(name, value)
        self._plant = Plant(knobs, Placement(*case.real.outline_mm, "top"), Faults(), seed)
        self._known = Known(folder, case.told, case.section, self._chance)
        needle = Needle(make_optics(), seed)
        self._drive = Drive(self._plant, Bodies(case.real.bodies), needle, self._known.config)
        self._points = list(case.told.test_points())
        self._theta_deg = 0.0
        self.tally = Tally()

    @property
    def has_points(self) -> bool:
        """Whether there are points left at which the head can stand."""
        return len(self._points) > FEWEST_POINTS

    def seat(self) -> None:
        """Lay the board in anew, and measure it; the head is up meanwhile."""
        up = replace(self._drive.position, z_um=self._drive.limits.safe_z_um)
        self._drive.go(plan(self._drive.position, up, self._drive.limits, self._drive.ends))
        self._plant.seat_board(self._plant.placement)
        self._known.measure(self._plant)

    async def one(self) -> None:
        """Place, and correct what is off, or a little more."""
        point = self._next_point()
        place_um = point.place_um
        if self._chance.random() < TURNED_SHARE:
            self._theta_deg = self._chance.choice((0.0, 45.0, 90.0, 200.0, 270.0, 359.0))
        target = self._known.geometry.position_over(place_um, self._theta_deg)
        target = replace(target, theta_deg=axis_theta_deg(target.theta_deg))
        clear = await self._known.clearance.by_calibration()
        if not self._go("place", target, clear):
            self._points.remove(point)
            return
        off_um = np.subtract(self._known.real_um(self._plant, place_um), self._drive.tip_um())
        if math.hypot(*off_um) < CORRECTED_UM:
            off_um = off_um + [self._chance.gauss(0.0, CORRECTED_UM) for _ in range(2)]
        here = self._drive.position
        nominal = self._known.geometry.from_tip_um(place_um, here)
        shift = float(off_um[0] - nominal[0]), float(off_um[1] - nominal[1])
        there = replace(here, x_um=here.x_um + float(off_um[0]), y_um=here.y_um + float(off_um[1]))
        if self._go("correct", there, await self._known.clearance.as_seen(shift)):
            self.tally.corrections += 1

    def _next_point(self) -> BoardPoint:
        """Draw a point: any of the board, or more often one of the nearest, as runs go from one to the next."""
        if self._chance.random() < FAR_SHARE:
            return self._chance.choice(self._points)
        x_um, y_um = self._known.geometry.robot_to_board_um(self._known.geometry.tip_um(self._drive.position))
        nearest = sorted(self._points, key=lambda point: math.dist(point.place_um, (x_um, y_um)))
        return self._chance.choice(nearest[:NEIGHBOURS])

    def _go(self, what: str, target: Position, clear: ClearHeight) -> bool:
        """Go there and count what was hit; False where that place is none to stand at."""
        slow_um = self._known.geometry.slow_z_um(target)
        here = self._drive.position
        try:
            legs = plan(here, target, self._drive.limits, self._drive.ends, frozenset(), slow_um, clear)
        except EnvelopeViolation:
            return False
        hits = self._drive.go(legs)
        self.tally.rises_um[what].append(_across_um(here, legs) - self._known.config.gantry.touch_z_um)
        if not hits:
            self.tally.places += what == "place"
            return True
        # What stands where the needle goes down is met whichever way it came: it is judged without the way
        if self._drive.hit_here() is not None and not self._sideways(hits):
            self.tally.left_out += 1
        else:
            self.tally.places += what == "place"
            self.tally.hits += hits
        up = replace(self._drive.position, z_um=self._drive.limits.safe_z_um)
        self._drive.go(plan(self._drive.position, up, self._drive.limits, self._drive.ends))
        return False

    def _sideways(self, hits: list[Hit]) -> bool:
        """Whether anything was hit elsewhere than straight above where the head stands now."""
        x_mm, y_mm = self._plant.to_cad_mm(*self._drive.tip_um())
        return any(math.dist(hit.cad_mm, (x_mm, y_mm)) > 0.02 for hit in hits)


def _across_um(here: Position, legs: list[Leg]) -> float:
    """Return the height at which the way goes across; where nothing does, that where the head stands."""
    z_um = here.z_um
    for leg in legs:
        if "z" not in leg.to:
            return z_um
        z_um = leg.to["z"]
    return z_um
