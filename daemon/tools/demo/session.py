"""Session of the demonstration's tester: sets the station up, then triggers one correction after the other.

The tester does what a person and a tester do on a line: home, show the daemon the needle's end, calibrate the map, put
the head over test points, say "open". How good each landing was it asks the simulated station's truth, not the daemon.
"""

from __future__ import annotations

import math
import random
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from daemon.client import Client, Refused
from daemon.domain.board import Board, BoardPoint
from daemon.domain.results import JobResult
from daemon.domain.surface_points import LEAST_PLACES, surface_points
from daemon.tools.demo.processes import DemoBench
from daemon.tools.demo.true_place import off_um, touched_by

CLICK_ERROR_PX, CLICKS = 0.4, 5
"""A person who points at the needle's end in a magnified picture is off by this much (1 sigma), and clicks so often."""
BESIDE_BOARD_UM = 9000.0
"""Beside the board there is only the dark base plate: the low-noise background on which the thesis teaches the tip."""
ANGLES_DEG = (0.0, 100.0), (140.0, 359.9)
LIMIT_UM = 50.0
LEAST_FIDUCIALS = 3
ALONE_UM = 2500.0
LARGEST_MARK_UM = 700.0
LONG_MS = 3600e3
"""More than any calibration takes."""
Say = Callable[[str], None]


class SetUpError(Exception):
    """The station could not be set up; the message says which step failed and why."""


@dataclass(frozen=True)
class Landing:
    """One test point's story: the daemon's answer, and the truth before and after."""

    point: BoardPoint
    theta_deg: float
    before_um: float
    after_um: float
    result: JobResult
    touched: str = ""
    """What the needle is over after all, by the truth: pin and net, or what else is there."""
    right_metal: bool = True

    @property
    def good(self) -> bool:
        """Whether the daemon answered that it landed, and it did."""
        return self.result.ok and self.after_um <= LIMIT_UM and self.right_metal


def choose_points(board: Board, at_most: int) -> list[BoardPoint]:
    """Return the best point of each net, spread over the nets; without layers the named test points, else vias."""
    if board.layers is not None:
        best = {net: board.of_net(net)[0] for net in sorted({p.net for p in board.test_points() if p.net})}
        step = max(1.0, len(best) / at_most)
        return [list(best.values())[int(k * step)] for k in range(min(at_most, len(best)))]
    offered = board.round_points()
    named = [p for p in offered if p.name.startswith("TP")]
    return sorted(named or offered, key=lambda p: [int(s) if s.isdigit() else s for s in re.split(r"(\d+)", p.name)])[
        :at_most
    ]


def solitude_um(board: Board, point: BoardPoint) -> float:
    """Return how far away the next target is that looks alike."""
    others = board.lookalikes_um(point, within_um=20_000.0)[1:]
    return min((math.dist(other, point.place_um) for other in others), default=20_000.0)


def choose_fiducials(board: Board) -> list[BoardPoint]:
    """Return what the board is aligned by: its fiducials, else four targets that stand alone, far apart."""
    fiducials = [p for p in board.points if p.kind == "fiducial"]
    if len(fiducials) >= LEAST_FIDUCIALS:
        return fiducials
    alone = sorted(board.flat_points(), key=lambda p: -min(solitude_um(board, p), ALONE_UM))
    candidates = [p for p in alone if solitude_um(board, p) >= ALONE_UM] or alone[:12]
    chosen = candidates[:1]
    while len(chosen) < min(4, len(candidates)):
        chosen.append(max(candidates, key=lambda p: min(math.dist(p.place_um, c.place_um) for c in chosen)))
    return chosen if len(chosen) >= LEAST_FIDUCIALS else []


def choose_mark(board: Board) -> BoardPoint | None:
    """Return the round target that stands most alone among its likes, a fiducial if there is one; None: none is."""
    round_ones = [p for p in board.points if p.stands_round and p.round_um <= LARGEST_MARK_UM]
    marks = [p for p in round_ones if p.kind == "fiducial" or (p.probeable and p.hole_um is None)] or round_ones
    return max(
        marks, key=lambda p: (p.kind == "fiducial", min(solitude_um(board, p), 4000.0), -p.round_um), default=None
    )


def point_at_tip(bench: DemoBench, chance: random.Random) -> list[float]:
    """Point at the needle's end as a person would on the page: well but not perfectly, a few times; return the mean."""
    true_px = bench.ask("status")["tip_px"]
    clicks = [[at + chance.gauss(0, CLICK_ERROR_PX) for at in true_px] for _ in range(CLICKS)]
    return [sum(axis) / CLICKS for axis in zip(*clicks, strict=True)]


class Session:
    """Set up and test; each step is told through `say`."""

    def __init__(self, client: Client, bench: DemoBench, board: Board, seed: int, say: Say) -> None:
        self._client, self._bench, self._board, self._say = client, bench, board, say
        self._random = random.Random(seed)  # noqa: S311  # a repeatable demonstration, not a secret
        self._seed = seed

    def set_up(self) -> None:
        """Home, teach the tip, calibrate the map."""
        self._say("homing")
        self._must("home")
        self.teach_tip()
        mark = choose_mark(self._board)
        self._say(f"calibrating the map on {'the control point' if mark is None else mark.name}")
        target = {} if mark is None else {"test_point": mark.name}
        self._must("calibrate", what="map", deadline_ms=LONG_MS, **target)

    def show_the_eye(self) -> None:
        """Land on the mark by the eye, as soon as there is a map: what all this is for is seen at once."""
        mark = choose_mark(self._board)
        if mark is None or not mark.probeable:  # a fiducial is looked at, and never landed on
            return
        self._say(f"first landing: {mark.name}, by the eye alone")
        try:
            landing = self._landed(mark, 0.0)
        except (SetUpError, Refused):  # what is not seen yet is no trouble: the board is aligned next
            landing = None
        if landing is None or landing.result.error is not None:
            self._say(f"{mark.name}: not before the board is aligned")
        else:
            was, left = f"{landing.before_um:.0f} um", f"{landing.after_um:.0f} um"
            self._say(f"{mark.name}: the needle was {was} off, and is {left} off now")

    def teach_tip(self) -> None:
        """Drive beside the board and point at the needle's end."""
        self._say("teaching the tip")
        self._must("place", board_um=[-BESIDE_BOARD_UM, self._board.height_um / 2], theta_deg=0.0)
        self._must("calibrate", what="tip", tip_px=point_at_tip(self._bench, self._random))

    def calibrate_fully(self, angles: int, board_id: str | None = None) -> None:
        """Calibrate the head's rotation, align the board that lies there, and measure the height of its surface."""
        self._say(f"calibrating the rotation at {angles} angles")
        self._must("calibrate", what="rotation", angles=angles, deadline_ms=LONG_MS)
        fiducials = choose_fiducials(self._board)
        named = {} if board_id is None else {"board_id": board_id}
        if self._board.layers is not None:
            self._say("aligning the board by its seat")
            self._aligned(self._must("align", deadline_ms=LONG_MS, **named))
        elif fiducials:
            self._say("aligning the board")
            self._must("align", fiducials=[p.name for p in fiducials], deadline_ms=LONG_MS, **named)
        if surface_points(self._board).number >= LEAST_PLACES:
            self._say("measuring the surface")
            self._must("calibrate", what="surface", deadline_ms=LONG_MS)

    def _aligned(self, result: JobResult) -> None:
        shift_um = result.detail.get("shift_um")
        if shift_um:
            off_um, turn_deg = math.hypot(*shift_um), float(result.detail.get("turn_deg", 0.0))
            self._say(f"the board lies {off_um:.0f} um and {abs(turn_deg):.2f} degrees off its place")

    def land(self, point: BoardPoint) -> Landing:
        """Put the head over a test point with all its errors, say "open", and ask the truth before and after."""
        landing = self._landed(point, self._angle())
        retest = "pass" if landing.after_um <= LIMIT_UM and landing.right_metal else "open"
        self._client.request("report", id=landing.result.id, retest=retest, touches=1)
        return landing

    def _landed(self, point: BoardPoint, theta_deg: float) -> Landing:
        placed = self._must("place", test_point=point.name, theta_deg=theta_deg)
        before_um = self._truth_um(point, placed)
        result = self._client.job("correct", job_id=f"{point.name}-seed{self._seed}", test_point=point.name)
        after_um = self._truth_um(point, result if result.ok else placed)
        touched = touched_by(self._bench)
        return Landing(point, theta_deg, before_um, after_um, result, str(touched), touched.is_of(point))

    def _must(self, op: str, **fields: Any) -> JobResult:
        result = self._client.job(op, timeout_s=LONG_MS / 1e3, **fields)
        if result.error is not None:
            raise SetUpError(f"{op} failed: {result.error.message} ({result.error.name}); {result.error.advice}")
        return result

    def _angle(self) -> float:
        """Draw an allowed head angle that the motor can stand at: a multiple of 0.05625 degrees."""
        low, high = self._random.choice(ANGLES_DEG)
        return round(self._random.uniform(low, high) / 0.05625) * 0.05625 % 360.0

    def _truth_um(self, point: BoardPoint, result: JobResult) -> float:
        """Return how far the tip really is from the pad's real centre, or from the site that was chosen on it."""
        x_um, y_um = self._bench.ask("truth")["board_um"]
        return off_um(point, result, (x_um, y_um))
