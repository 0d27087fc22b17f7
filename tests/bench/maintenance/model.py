"""A station as maintenance sees it: days of work, boards, chance, and one degradation where wanted.

Where its figures come from. Stops and the tip's place: 1,742 first moves of seven simulated stations (the plant's
defaults: 8 um of repeatability, the head's run-out of the thesis' appendix D, 15 um of board height, glints, flex of
the camera's arm), as their journals have them; the needle: 525 looks of two of them. The thesis: 5 % of the touches are
corrected. What no source gives is chosen to be unkind: a board's points fail together, a lamp grows warm each morning,
errors on lines and lost pictures come in bursts, and a share of all numbers is far out. None of it is what the charts
assume: numbers hang together within a job and within a board, have heavy tails, and follow the hour.

What goes through is what the daemon sees: results and steps as jobs leave them, turned into numbers by the daemon's own
rooms. A history of 10,000 touches takes about half a second.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Any

from daemon.domain.point_test import PointRecord, PointVerdict, Rung
from daemon.domain.results import ErrorBody, JobResult
from daemon.maintenance.contact_signals import Contacts
from daemon.maintenance.panel import Row
from daemon.maintenance.signals import AxisWords, Landings, Numbers, Step, of_axes, of_ending, of_looks
from tests.bench.maintenance.wrong import SHARE, Wrong

PHASE_DEG = -3.054
TIP_PX = (428.0, 620.5)
TOUCHES_A_REPORT = 20
TOUCHES_A_DAY, WORKING_H = 2000, 8.0
TOUCHES_A_BOARD = 120
POINTS = 24
"""Test points of the board; the program comes to each at an angle of its own."""
STOP_UM, LOOK_UM = 8.0, 8.0
RUNOUT_UM = 13.0
HARMONICS = (9, 10, 11, 12, 14, 17)
"""What the head model leaves: orders beyond its own."""
BOARD_UM, HEIGHT_UM, NEST_UM, ALIGNED_UM = (18.0, -16.0), 15.0, 12.0, 4.0
"""The mean miss on a board; sigma of its height, seen as a miss at 45 degrees; of its place in the nest; aligned."""
TOLERANCE_UM = 15.0
FAR_OUT = 0.02
"""Share of numbers that are far out: a glint, an edge of something else beside the needle."""
RUNG_SHARES = ((Rung.LOOK, 0.05), (Rung.REFERENCE, 0.002), (Rung.SECOND_SITE, 0.001))
"""Shares of points that need them: misplaced as in the thesis, debris, stubborn films; films stand in `Wrong`."""
NO_CONTACT, REFERENCE_OHM = 0.003, 0.02
"""Share of points without contact; sigma of the reference pad's readings, one a board."""
REQUESTS_A_S, FRAMES_A_S = 12.0, 15.0
START = datetime(2026, 11, 1, 6, tzinfo=UTC)


@dataclass
class _Probe:
    """A needle as taught: no two look quite the same."""

    random: random.Random
    width_px: float = field(init=False)
    contrast: float = field(init=False)
    light: float = field(init=False)
    sharpness: float = field(init=False)
    tip_px: tuple[float, float] = field(init=False)
    length_px: float = field(init=False)

    def __post_init__(self) -> None:
        gauss = self.random.gauss
        self.width_px, self.contrast = gauss(42.1, 0.6), gauss(0.78, 0.03)
        self.light, self.sharpness = gauss(119.0, 4.0), gauss(0.20, 0.015)
        self.tip_px, self.length_px = (gauss(0.0, 0.4), gauss(0.0, 0.4)), gauss(-1.5, 1.5)


class StationModel:
    """Draw rows of one station; `seed` gives its own run-out, boards, needle, and all chance.

    Stations with an even seed align every board, the others trust their nest. service: touches after which the probe
    is changed and everything calibrated anew; twice that, rotation and map are calibrated again.
    """

    def __init__(self, seed: int, service: int = 0) -> None:
        self._random = random.Random(seed)
        self._contact = random.Random(seed + 1_000_000)  # of its own: all else is drawn as before there were points
        self._landings = Landings(PHASE_DEG)
        self._aligns, self._service = seed % 2 == 0, service
        self.touches = self._jobs = self._served = 0
        self.bases = {"probe": "p0", "map": "m0", "rotation": "r0", "surface": "s0", "alignment": "a0"}
        self._angles = [self._angle(k) for k in range(POINTS)]
        self._probe = _Probe(self._random)
        self._calibrate()
        self._next_board()

    # --- what changes now and then ----------------------------------------------------------------------------

    def _angle(self, k: int) -> float:
        """Return the head angle of a point: they are spread over the 320 that the head can take."""
        return (140.0 + 320.0 * (k + self._random.random()) / POINTS) % 360.0

    def _calibrate(self) -> None:
        """Draw what a rotation's model leaves; every calibration leaves something else."""
        size = RUNOUT_UM / math.sqrt(2.0 * len(HARMONICS))
        self._runout = [(n, *(self._random.gauss(0.0, size) for _ in range(4))) for n in HARMONICS]

    def _next_board(self) -> None:
        """Put the next board in: its place, how many of its points fail, and which."""
        gauss, nest_um = self._random.gauss, ALIGNED_UM if self._aligns else NEST_UM
        high = gauss(0.0, HEIGHT_UM) / math.sqrt(2.0)
        self._board_um = (gauss(0.0, nest_um) + high, gauss(0.0, nest_um) - high)
        self._badness = self._random.gammavariate(2.0, 0.5)
        self._bad_angles = self._random.choices(self._angles, k=6)
        if self._aligns:
            self.bases["alignment"] = f"a{self.touches}"

    def _serve(self) -> None:
        """Change the probe and calibrate everything; the second time, calibrate rotation and map only."""
        if not self._service or self.touches < self._service * (self._served + 1) or self._served == 2:
            return
        self._served += 1
        self._calibrate()
        if self._served == 1:
            self._probe = _Probe(self._random)
        for kind in ("probe", "map", "rotation", "surface") if self._served == 1 else ("map", "rotation"):
            self.bases[kind] = f"{kind}{self._served}"

    # --- time -------------------------------------------------------------------------------------------------

    def _at(self) -> str:
        days, today = divmod(self.touches, TOUCHES_A_DAY)
        return (START + timedelta(days=days, hours=WORKING_H * today / TOUCHES_A_DAY)).isoformat(
            timespec="milliseconds"
        )

    @property
    def _warm(self) -> float:
        """How warm the station is, 0 in the morning to 1."""
        return 1.0 - math.exp(-(self.touches % TOUCHES_A_DAY) / 300.0)

    # --- rows -------------------------------------------------------------------------------------------------

    def rows(self, wrong: Wrong) -> Iterator[Row]:
        """Yield what is written down while `TOUCHES_A_REPORT` touches are made."""
        if self.touches % TOUCHES_A_BOARD == 0:
            self._next_board()
        self._serve()
        chance = min(1.0, wrong.share * self._badness)
        corrections = sum(self._random.random() < chance for _ in range(TOUCHES_A_REPORT))
        for _ in range(corrections):
            yield self._correction(wrong, 1.0 / (SHARE * TOUCHES_A_DAY))
        self.touches += TOUCHES_A_REPORT
        numbers: Numbers = {"correction_share": [float(corrections), float(TOUCHES_A_REPORT)]}
        yield Row(self._at(), self.touches, "", numbers, dict(self.bases))
        yield Row(self._at(), self.touches, "", self._points(wrong), dict(self.bases))

    def _points(self, wrong: Wrong) -> Numbers:
        """Draw the points of a run: most pass at once, the others come to their verdict by one rung or none."""
        contacts, draw = Contacts(), self._contact.random
        for number in range(TOUCHES_A_REPORT):
            verdict, rung = PointVerdict.PASS_FIRST, None
            for one, share in ((Rung.PUMP, wrong.films), *RUNG_SHARES):
                if draw() < share * self._badness:
                    verdict, rung = PointVerdict.PASS_RECOVERED, one
            if draw() < NO_CONTACT:
                verdict, rung = PointVerdict.CONTACT_NOT_MADE, None
            contacts.add(
                PointRecord(
                    point=str(number), net=None, board_id=None, method="continuity", limits=None, verdict=verdict,
                    recovered_by=rung, seconds=1.0, at=self._at(),
                )
            )  # fmt: skip
        if self.touches % TOUCHES_A_BOARD == 0:
            far_out = self._contact.random() < FAR_OUT
            ohm = wrong.reference_ohm + self._contact.gauss(0.0, REFERENCE_OHM) * (5.0 if far_out else 1.0)
            contacts.add_step({"on": "reference pad", "ohm": ohm})
        return contacts.take()

    def _correction(self, wrong: Wrong, day: float) -> Row:
        self._jobs += 1
        result, steps = self._job(wrong)
        numbers = of_ending(result) | self._landings.numbers(result, steps) | of_looks(steps, TIP_PX)
        if steps:
            numbers |= self._pictures(wrong)
        more, words = self._devices(wrong, day * WORKING_H * 3600.0)
        return Row(self._at(), self.touches, result.id, numbers | more, dict(self.bases), words)

    def _job(self, wrong: Wrong) -> tuple[JobResult, list[Step]]:
        """Draw one correction: where the tip landed, and where it was after the moves that it took."""
        theta_deg = self._random.choice(self._bad_angles)
        facts: dict[str, Any] = {
            "id": f"job-{self._jobs}", "op": "correct", "seq": self._jobs, "station": "model",
            "finished_at": self._at(),
        }  # fmt: skip
        for name, chance in wrong.failures:
            if self._random.random() < chance * self._badness:
                error = ErrorBody(code=1, name=name, message="", advice="")
                return JobResult(ok=False, outcome="failed", looks=1, moves=0, error=error, **facts), []
        x_um, y_um = self._miss_um(theta_deg, wrong)
        shared = self._random.gauss(0.0, 1.0)
        steps: list[Step] = [("look", self._look((x_um, y_um), theta_deg, shared, wrong))]
        moves, left_um = 0, math.hypot(x_um, y_um)
        while left_um > TOLERANCE_UM and moves < 8:
            after_um = (self._stop_um(wrong), self._stop_um(wrong))
            if self._random.random() < 0.001:  # another pad was taken for the target
                after_um = (self._random.uniform(60.0, 110.0), 0.0)
            steps += [("move", {}), ("look", self._look(after_um, theta_deg, shared, wrong))]
            moves, left_um = moves + 1, math.hypot(*after_um)
        facts |= {"looks": moves + 1, "moves": moves, "error_before_um": math.hypot(x_um, y_um)}
        return JobResult(ok=True, outcome="corrected", **facts), steps

    def _miss_um(self, theta_deg: float, wrong: Wrong) -> tuple[float, float]:
        """Return where the tip lands from the pad, robot frame."""
        turn = math.radians(theta_deg)
        x = sum(a * math.cos(n * turn) + b * math.sin(n * turn) for n, a, b, _, _ in self._runout)
        y = sum(c * math.cos(n * turn) + d * math.sin(n * turn) for n, _, _, c, d in self._runout)
        out = turn + math.radians(PHASE_DEG)
        knocked = wrong.sector_um if 225.0 <= theta_deg % 360.0 < 270.0 else 0.0
        along, away = wrong.slip_um, wrong.reach_um + knocked
        x += BOARD_UM[0] + self._board_um[0] + wrong.board_um + 3.0 * self._warm
        y += BOARD_UM[1] + self._board_um[1] + 3.0 * self._warm
        x += away * math.cos(out) - along * math.sin(out) + self._stop_um(wrong)
        y += away * math.sin(out) + along * math.cos(out) + self._stop_um(wrong)
        return x, y

    def _stop_um(self, wrong: Wrong) -> float:
        """Draw one axis' error of a stop as a look sees it."""
        gauss = self._random.gauss
        play = self._random.uniform(-1.0, 1.0) * wrong.play_um
        return gauss(0.0, STOP_UM / math.sqrt(2.0)) + gauss(0.0, LOOK_UM / math.sqrt(2.0)) + play

    def _tailed(self, sigma: float, times: float = 5.0) -> float:
        """Draw a number of which some are far out."""
        return self._random.gauss(0.0, sigma * (times if self._random.random() < FAR_OUT else 1.0))

    def _look(self, at_um: tuple[float, float], theta_deg: float, shared: float, wrong: Wrong) -> dict[str, Any]:
        """Draw one look; `shared` is what all looks of a job have in common: the ground around its point."""
        probe, bend_px = self._probe, wrong.bend_px
        needle = {
            "width_px": probe.width_px + 0.045 * shared + self._tailed(0.04) - 0.02 * wrong.worn_px,
            "contrast": (probe.contrast + 0.002 * shared + self._tailed(0.004)) * wrong.marking,
            "bend_px": -0.1 + 0.05 * shared + self._tailed(0.12) + bend_px,
            "sharpness": (probe.sharpness + 0.002 * shared + self._tailed(0.005)) * wrong.focus,
        }
        warm_px, gauss = 0.3 * self._warm, self._random.gauss
        x_px = probe.tip_px[0] + wrong.knock_px + 0.5 * bend_px + warm_px + gauss(0.0, 0.72)
        y_px = probe.tip_px[1] + warm_px + gauss(0.0, 0.72)
        tip_px = [TIP_PX[0] + x_px, TIP_PX[1] + y_px]
        return {"dx_um": -at_um[0], "dy_um": -at_um[1], "theta_deg": theta_deg, "tip_px": tip_px, "needle": needle}

    def _pictures(self, wrong: Wrong) -> Numbers:
        """Draw what is measured on the last look's pictures."""
        hour = 1.0 - 0.015 * self._warm
        numbers: Numbers = {
            "light_white": [(self._probe.light + self._tailed(0.3)) * hour * wrong.white],
            "light_red": [(0.38 * self._probe.light + self._tailed(0.15)) * hour * wrong.red],
            "noise": [(0.525 + 0.02 * self._warm + self._tailed(0.009)) * wrong.noise],
        }
        if self._random.random() < 0.8:
            astray = self._random.random() < 0.12
            away_px = -8.0 if astray else 0.0
            numbers["tip_length"] = [self._probe.length_px + away_px + self._random.gauss(0.0, 3.0) - wrong.worn_px]
        return numbers

    def _devices(self, wrong: Wrong, seconds: float) -> tuple[Numbers, dict[str, str]]:
        """Draw what the devices counted in the seconds since the last correction."""
        warns = {"z"} if wrong.drive_warns else set()
        axes = [
            AxisWords(name, name in warns, "", abs(self._tailed(0.1 if name != "theta" else 0.002)) + add)
            for name, add in (("x", wrong.following_um), ("y", 0.0), ("z", 0.0), ("theta", 0.0))
        ]
        arrivals = {name: abs(self._tailed(0.1)) for name in ("y", "z")} | {"theta": abs(self._tailed(0.002))}
        arrivals["x"] = abs(self._tailed(0.1)) + wrong.following_um
        numbers, words = of_axes(axes, arrivals)
        requests, frames = round(REQUESTS_A_S * seconds), round(FRAMES_A_S * seconds)
        numbers |= {
            "bus_timeouts_main": [self._bursts(requests, wrong.timeouts, 3), requests],
            "bus_garbled_main": [self._bursts(requests, wrong.garbled, 3), requests],
            "frames": [self._bursts(frames, wrong.torn, 2), frames],
            "frames_missed": [self._bursts(frames, wrong.missed, 30), frames],
            "calibration_age": [wrong.map_days, 24.0, 30.0],
            "probe_life": [wrong.probe_touches, 100_000.0, 125_000.0],
        }
        return numbers, words

    def _bursts(self, trials: int, chance: float, longest: int) -> float:
        """Draw how many of the trials fail; failures come in bursts of 1 to `longest`, their mean share is `chance`."""
        bursts, mean = 0, trials * chance / ((1 + longest) / 2.0)
        left = math.exp(-mean) if mean < 500.0 else 0.0
        if not left:  # so many that chance no longer matters
            return float(min(trials, round(trials * chance)))
        product = self._random.random()
        while product > left:  # Knuth's way to a Poisson number
            bursts, product = bursts + 1, product * self._random.random()
        return float(min(trials, sum(self._random.randint(1, longest) for _ in range(bursts))))
