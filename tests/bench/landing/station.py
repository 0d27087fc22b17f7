"""One simulated station with its daemon in an operator's hands: set up as a person would, then tried again and again.

The operator speaks the daemon's wire and nothing else; how far the tip really is from a pad, the station's truth says.
"""

from __future__ import annotations

import os
import random
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from daemon.client import Client, NoAnswer
from daemon.domain.board import Board, BoardPoint
from daemon.domain.results import JobResult
from daemon.tools.demo.processes import StartError
from daemon.tools.demo.session import BESIDE_BOARD_UM, choose_fiducials, choose_mark, choose_points, point_at_tip
from daemon.tools.demo.true_place import same_net
from sim_hw.board.board import Board as RealBoard
from sim_hw.board.board import load_board
from sim_hw.board.surface import Surface
from tests.bench.landing.judge import CORRECTED_UM
from tests.bench.landing.trials import Landed, Question, Step, Trial, Way
from tests.station.rig import Rig

STEPS = ("home", "tip", "map", "rotation", "align", "surface")
PATIENCE_S, ASK_AGAIN_S = 900.0, 5.0
ROTATION_ANGLES = 32
HOLE_UM = 400.0
"""The target of a drilled pad is its hole; its metal is then no farther than this."""


class Interrupted(Exception):
    """The campaign was told to end."""


class SetUpFailed(Exception):
    """A step of the set-up ended in an error; `steps` are all that were tried."""

    def __init__(self, steps: Sequence[Step]) -> None:
        self.steps = tuple(steps)
        super().__init__(f"{steps[-1].name}: {steps[-1].error}")


class Operator:
    """Set up one station and try landings on it."""

    def __init__(
        self, rig: Rig, client: Client, folder: Path, seed: int, stop: threading.Event, *, strict: bool = True
    ) -> None:
        """`strict`: raise ValueError where the simulated station has no metal at one of the board file's points."""
        self._rig, self._client, self._seed, self._stop = rig, client, seed, stop
        self._random = random.Random(f"{seed}/operator")
        self._points = {point.name: point for point in choose_points(rig.board, len(rig.board.points))}
        self.missing = not_there(rig.board, load_board(folder, rig.board.side))
        """Points at which the simulated station has no metal of the net: both read CAD for themselves."""
        if strict and self.missing:
            raise ValueError(
                f"the simulated station has no metal of the net where the board file has {', '.join(self.missing)}"
            )
        self._steps: dict[str, Callable[[], JobResult]] = {
            "home": lambda: self.job("home", "home"),
            "tip": self._teach_tip,
            "map": self._calibrate_map,
            "rotation": lambda: self._calibrate("rotation", angles=ROTATION_ANGLES),
            "align": self._align,
            "surface": lambda: self._calibrate("surface"),
        }

    @property
    def test_points(self) -> list[str]:
        """Names of the test points that are tried."""
        return list(self._points)

    def set_up(self, steps: Sequence[str], say: Callable[[str], None]) -> list[Step]:
        """Do the steps in their order; raise `SetUpFailed` at the first error."""
        done = []
        for name in steps:
            say(name)
            started_s, simulated_s = time.monotonic(), self._simulated_s()
            result = self._steps[name]()
            error = None if result.error is None else f"{result.error.name}: {result.error.message}"
            took_s = self._simulated_s() - simulated_s
            done.append(Step(name, round(took_s, 2), round(time.monotonic() - started_s, 2), result.detail, error))
            if error is not None:
                raise SetUpFailed(done)
        return done

    def run(self, question: Question) -> Trial:
        """Land exactly, land beside the point, correct; ask the truth after each."""
        point, name = self._points[question.test_point], f"{question.seed}-{question.index}"
        trial = Trial(question.seed, question.index, self._rig.board.name, self._rig.board.side, question.test_point,
                      question.theta_deg, question.offset_um)  # fmt: skip
        landed = self.job(f"{name}-first", "place", test_point=point.name, theta_deg=question.theta_deg)
        if landed.error is not None:
            return _answered(trial, landed)
        trial = replace(trial, first_um=self._truth_um(point))
        beside = [point.x_um + question.offset_um[0], point.y_um + question.offset_um[1]]
        landed = self.job(f"{name}-beside", "place", board_um=beside, theta_deg=question.theta_deg)
        if landed.error is not None:
            return _answered(trial, landed)
        trial = replace(trial, before_um=self._truth_um(point))
        corrected = self.job(f"{name}-correct", "correct", test_point=point.name)
        under = self._rig.truth()["on"]
        on = Landed(under["what"], under.get("net"), under.get("pin"), under.get("inside_um"))
        trial = _answered(replace(trial, after_um=self._truth_um(point), net=point.net, on=on), corrected)
        if trial.error is None and trial.after > CORRECTED_UM:  # it believes in it: what it sees there is worth keeping
            seen = self.job(f"{name}-look", "look", test_point=point.name, pictures=True)
            trial = replace(trial, pictures=seen.pictures)
        return trial

    # --- steps of the set-up ---------------------------------------------------------------------------------

    def _teach_tip(self) -> JobResult:
        """Drive beside the board and point at the needle's end, well but not perfectly."""
        beside = [-BESIDE_BOARD_UM, self._rig.board.height_um / 2]
        placed = self.job("tip-place", "place", board_um=beside, theta_deg=0.0)
        if placed.error is not None:
            return placed
        return self.job("tip", "calibrate", what="tip", tip_px=point_at_tip(self._rig.bench, self._random))

    def _calibrate_map(self) -> JobResult:
        mark = choose_mark(self._rig.board)
        return self._calibrate("map", **({} if mark is None else {"test_point": mark.name}))

    def _align(self) -> JobResult:
        if self._rig.board.layers is not None:
            return self.job("align", "align", deadline_ms=PATIENCE_S * 1e3)
        fiducials = [point.name for point in choose_fiducials(self._rig.board)]
        return self.job("align", "align", fiducials=fiducials, deadline_ms=PATIENCE_S * 1e3)

    def _calibrate(self, what: str, **fields: Any) -> JobResult:
        return self.job(what, "calibrate", what=what, deadline_ms=PATIENCE_S * 1e3, **fields)

    # --- asking ----------------------------------------------------------------------------------------------

    def job(self, job_id: str, op: str, **fields: Any) -> JobResult:
        """Run a job to its result. Asked again with the same id, the daemon does nothing twice."""
        give_up_s = time.monotonic() + PATIENCE_S
        while True:
            try:
                return self._client.job(op, job_id=job_id, timeout_s=ASK_AGAIN_S, **fields)
            except NoAnswer:
                if self._stop.is_set():
                    raise Interrupted from None
                if not self._rig.daemon.alive():
                    raise StartError(f"the daemon ended: {self._rig.daemon.last_words()}") from None
                if time.monotonic() > give_up_s:
                    raise

    def _simulated_s(self) -> float:
        return float(self._rig.truth()["t_s"])

    def _truth_um(self, point: BoardPoint) -> Way:
        """Return tip minus the point's place on the board as it really lies, in the board's frame."""
        x_um, y_um = self._rig.truth()["board_um"]
        return round(float(x_um) - point.x_um, 3), round(float(y_um) - point.y_um, 3)


def not_there(board: Board, real: RealBoard) -> list[str]:
    """Name the points at which the simulated station has no bare metal of the point's net."""
    surface = Surface(real)
    return [point.name for point in board.test_points() if not _is_there(point, surface, real)]


def _is_there(point: BoardPoint, surface: Surface, real: RealBoard) -> bool:
    x0_mm, y0_mm, x1_mm, _ = real.outline_mm
    across_mm = point.x_um / 1e3
    spot = surface.at(x0_mm + across_mm if real.side == "top" else x1_mm - across_mm, y0_mm + point.y_um / 1e3)
    in_hole = spot.what == "hole" and spot.away_um is not None and spot.away_um < HOLE_UM
    return (spot.what == "metal" or in_hole) and same_net(spot.net, point.net)


def processor_ms(pid: int) -> float:
    """Return the processor time that a process has used."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return 1e3 * (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _answered(trial: Trial, result: JobResult) -> Trial:
    """Add what the daemon answered."""
    error = result.error
    return replace(
        trial,
        outcome=result.outcome,
        error=error.name if error else None,
        message=error.message if error else None,
        looks=result.looks,
        moves=result.moves,
        said_before_um=result.error_before_um,
        said_after_um=result.error_after_um,
        pictures=result.pictures if error else None,
    )
