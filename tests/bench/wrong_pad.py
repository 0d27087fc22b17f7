"""Benchmark of wrong pads: on boards displaced, turned or exchanged the daemon must never claim another pad.

`python -m tests.bench.wrong_pad --rows displaced=12,turned=4 --seed 1` runs simulated stations with their daemons and
asks each one's truth what is under the needle when the daemon says `corrected`. Wrong: another pad, or none. Named: a
refusal whose name says what was done to the board.
"""

from __future__ import annotations

import argparse
import json
import random
import tempfile
import threading
import time
import zlib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from daemon.client import Client, Refused
from daemon.domain.board import BoardPoint
from daemon.domain.results import JobResult
from daemon.tools.demo.processes import DemoBench
from daemon.tools.demo.true_place import off_um, same_net
from tests.station.rig import Rig, running_rig

WANTED = {"displaced": 72, "stalled": 12, "shifted": 24, "turned": 16, "another": 20, "calibrated": 12}
OTHERS = Path(__file__).parents[3] / "shared" / "boards"
NEAR_UM = 60.0
LOOKED_OUT_S = 3.0
"""Time for the simulated station to draw another board."""
AWAY = frozenset({"wrong_place", "not_at_test_point", "correction_too_large", "not_aligned"})
NAMES = {
    "displaced": AWAY,
    "stalled": AWAY,
    "shifted": AWAY,
    "turned": frozenset({"board_turned"}),
    "another": frozenset({"not_this_board"}),
    "calibrated": AWAY,
}


@dataclass(frozen=True)
class Trial:
    """One try. right: the needle is on the pad that was asked for; wrong: the daemon claimed it, and it is not.

    number: of the try within its row; with the row's name and `--seed` it is the same one again.
    """

    row: str
    number: int
    test_point: str
    done: str
    answer: str
    message: str
    on: str
    away_um: float
    right: bool
    wrong: bool
    named: bool


@dataclass
class Bench:
    """A station and its client."""

    rig: Rig
    client: Client
    row: str
    home_um: tuple[float, float]

    def job(self, op: str, **fields: object) -> JobResult:
        return self.client.job(op, timeout_s=600.0, **fields)

    def move_board(self, dx_um: float, dy_um: float) -> None:
        self.rig.bench.ask("set", name="board_dx_um", value=self.home_um[0] + dx_um)
        self.rig.bench.ask("set", name="board_dy_um", value=self.home_um[1] + dy_um)

    def tried(
        self, point: BoardPoint, theta_deg: float, done: str, number: int, *, meanwhile: float | None = None
    ) -> Trial:
        """Place, correct, and ask the truth; `meanwhile`: seconds after which the board moves during the correction."""
        result = self.job("place", test_point=point.name, theta_deg=theta_deg)
        if result.error is None:
            mover = threading.Timer(meanwhile or 0.0, self._shift, args=(number,))
            if meanwhile is not None:
                mover.start()
            try:
                result = self.job("correct", test_point=point.name)
            finally:
                if meanwhile is not None:
                    mover.join()
        return self.judged(point, result, done, number)

    def _shift(self, number: int) -> None:
        chance = random.Random(number)
        size = chance.uniform(500.0, 3000.0)
        # A socket of its own: the bench's belongs to the main thread.
        other = Bench(
            replace(self.rig, bench=DemoBench(self.rig.places.socket("bench"))), self.client, self.row, self.home_um
        )
        try:
            other.move_board(size * chance.choice((-1.0, 1.0)), size * chance.uniform(-0.5, 0.5))
        finally:
            other.rig.bench.close()

    def judged(self, point: BoardPoint, result: JobResult, done: str, number: int) -> Trial:
        truth = self.rig.truth()
        away_um = off_um(point, result, tuple(truth["board_um"]))
        on = truth["on"]
        there = on["what"] in ("metal", "hole") and (point.net is None or same_net(on.get("net"), point.net))
        right = result.ok and there and away_um <= NEAR_UM and self.row != "another"
        answer = result.outcome if result.error is None else result.error.name
        message = "" if result.error is None else result.error.message
        named = result.ok or answer in NAMES[self.row]
        under = f"{on['what']} {on.get('pin')} {on.get('net')}"
        wrong = result.ok and not right
        return Trial(
            self.row, number, point.name, done, answer, message, under, round(away_um, 1), right, wrong, named
        )  # fmt: skip


def _displaced(bench: Bench, chance: random.Random, point: BoardPoint) -> str:
    others = [p for p in bench.rig.board.points if p is not point and p.kind == point.kind]
    near = [p for p in others if abs(p.x_um - point.x_um) < 5000 and abs(p.y_um - point.y_um) < 5000] or others
    other = chance.choice(near)
    # The board lies so that the other pad is where this one should be.
    dx, dy = point.x_um - other.x_um, point.y_um - other.y_um
    bench.move_board(dx, dy)
    return f"{other.name} in its place ({dx:.0f}, {dy:.0f} um)"


def trial(bench: Bench, number: int, seed: int) -> Trial:
    """Do one thing to the board, try, and undo it."""
    chance = random.Random(f"{bench.row}/{seed}/{number}")
    rig = bench.rig
    point = chance.choice(rig.board.test_points())
    theta = round(chance.choice((chance.uniform(0, 100), chance.uniform(140, 359))) / 0.05625) * 0.05625
    try:
        match bench.row:
            case "displaced":
                return bench.tried(point, theta, _displaced(bench, chance, point), number)
            case "calibrated":
                way = chance.choice(((-450.0, 0.0), (450.0, 0.0), (0.0, -450.0), (0.0, 450.0)))
                bench.move_board(*way)
                return bench.tried(point, theta, f"moved {way}", number)
            case "stalled":
                bench.job("place", test_point=chance.choice(rig.board.test_points()).name, theta_deg=theta)
                with rig.fault("stall", axis="x", detected=False):
                    placed = bench.job("place", test_point=point.name, theta_deg=theta)
                done = "X stalled in place"
                result = placed if placed.error is not None else bench.job("correct", test_point=point.name)
                return bench.judged(point, result, done, number)
            case "shifted":
                return bench.tried(point, theta, "moved in a look", number, meanwhile=chance.uniform(0.05, 1.2))
            case "turned":
                with rig.fault("board_turned"):
                    return bench.tried(point, theta, "turned by 180 degrees", number)
            case _:
                return bench.tried(point, theta, "another board", number)
    finally:
        bench.move_board(0.0, 0.0)
        if bench.row == "stalled":
            bench.job("home")


def run_row(row: str, count: int, seed: int) -> list[Trial]:
    """Set a station up and try a row's things on it. The row's name is part of its seed: it is the same alone."""
    if row == "another" and not _others():
        print(f"another: left out, there is no board in {OTHERS}", flush=True)
        return []
    seed = zlib.crc32(f"{row}/{seed}".encode()) % 10_000
    with tempfile.TemporaryDirectory() as folder, running_rig(Path(folder), seed=seed) as rig, rig.client() as client:
        start = rig.truth_start()["board_pose"]
        bench = Bench(rig, client, row, (start["dx_um"], start["dy_um"]))
        session = rig.session(client, seed)
        session.set_up()
        if row in ("calibrated", "stalled", "shifted"):
            _must(bench, "calibrate", what="rotation", angles=24, deadline_ms=3.6e6)
            _must(bench, "align")
        if row == "another":
            rig.bench.ask("board", folder=str(_another(seed)))
            time.sleep(LOOKED_OUT_S)
        done = []
        for number in range(count):
            if row in ("calibrated", "stalled", "shifted") and done and not done[-1].right:
                _must(bench, "align")
            try:
                done.append(trial(bench, number, seed))
            except Refused as refused:
                print(f"{row} {number}: {refused}", flush=True)
                client.request("reset")
                bench.job("home")
                continue
            print(json.dumps(asdict(done[-1])), flush=True)
        return done


def _must(bench: Bench, op: str, **fields: object) -> None:
    result = bench.job(op, **fields)
    if result.error is not None:
        raise RuntimeError(f"{op}: {result.error.name}: {result.error.message}")


def _another(seed: int) -> Path:
    boards = _others()
    return boards[seed % len(boards)]


def _others() -> list[Path]:
    if not OTHERS.is_dir():
        return []
    return sorted(p for p in OTHERS.iterdir() if p.is_dir() and p.name != "eagle-ipc-only")


def table(trials: list[Trial]) -> str:
    """Return counts by row."""
    lines = [f"{'row':12}{'tried':>7}{'right':>7}{'refused':>9}{'wrong':>7}{'named':>7}"]
    for row in WANTED:
        own = [t for t in trials if t.row == row]
        refused = [t for t in own if t.answer not in ("corrected", "already_on_target")]
        if own:
            named = f"{sum(t.named for t in refused)}/{len(refused)}"
            lines.append(f"{row:12}{len(own):7}{sum(t.right for t in own):7}{len(refused):9}"
                         f"{sum(t.wrong for t in own):7}{named:>7}")  # fmt: skip
    return "\n".join(lines)


def main() -> None:
    """Run the rows asked for, each on stations of its own."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", default=",".join(WANTED), help="names, or name=count; all by default")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=1, help="stations at a time")
    given = parser.parse_args()
    asked = [(name, int(count or WANTED[name])) for name, _, count in (r.partition("=") for r in given.rows.split(","))]
    with ThreadPoolExecutor(given.workers) as pool:
        runs = [pool.submit(run_row, row, count, given.seed) for row, count in asked]
        trials = [one for run in runs for one in run.result()]
    print(table(trials))


if __name__ == "__main__":
    main()
