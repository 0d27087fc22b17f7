"""Demonstration of the fleet: `make demo-fleet`, or `python -m tests.fleet.demo`.

Ten stations' journals, each with an uplink of its own, Mosquitto, `reprobe collect`, PostgreSQL and Prometheus, all on
loopback and all ended at the end. The records are planted (`planted`), the way they go is the real one. Fails where an
answer is not what was planted.
"""

from __future__ import annotations

import argparse
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import FrameType

from tests.bench.fleet import ask
from tests.fleet.demo.answers import QUESTIONS, Question, Rows
from tests.fleet.demo.drawn import draw
from tests.fleet.demo.plant import Plant
from tests.fleet.demo.planted import BAD_BOARD, BOARD, DRIFTS, SILENT, stations
from tests.fleet.engines import missing
from tests.packages import not_installed

LEAST_BOARDS = 12
"""Fewer leave what was planted to chance."""
LOOKED_AT = {"station": DRIFTS, "board": BAD_BOARD, "board_id": BOARD}
"""What the dashboards are drawn of."""
PATIENCE_S = 300.0
"""For what is waited for after the boards are tested."""
HONEST = """\
Ten stations in {seconds:g} s. Journals, records, uplinks, broker, collector, database and Prometheus are real and run
now, each station with processes of its own. What the stations find is planted, by a seed: no camera looks and nothing
moves, for ten stations that do are too much for one computer. `make demo` shows one that does.
Planted: station-03 drifts, station-08 has a worn needle, TP7 of the board design "sensor" is bad wherever it is made,
station-05 runs an older program, board B-000117 came to two stations, station-10 goes silent at the end.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the answers; exit code 1 where one is not what was planted."""
    parser = argparse.ArgumentParser(prog="make demo-fleet", description=__doc__.splitlines()[0])
    parser.add_argument("--boards", type=int, default=24, help="boards that each station tests")
    parser.add_argument("--seconds", type=float, default=100.0, help="over which they are spread")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--draw", type=Path, metavar="FOLDER", help="draw the dashboards there, with what they ask")
    parser.add_argument("--stay", action="store_true", help="leave everything running until Ctrl-C, to look at")
    told = parser.parse_args(arguments)
    if told.boards < LEAST_BOARDS or told.seconds < 0:
        parser.error(f"--boards: {LEAST_BOARDS} at least; --seconds: 0 at least")
    if lacking := missing(("mosquitto", "postgresql", "prometheus")):
        print(not_installed(*lacking), file=sys.stderr)
        return 2
    before = signal.signal(signal.SIGTERM, _leave)
    try:
        with ExitStack() as stack:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="reprobe-demo-fleet-")))
            folder.chmod(0o711)  # the broker becomes another user
            print(HONEST.format(seconds=told.seconds), flush=True)
            plant = Plant(folder, stack, boards=told.boards, seconds=told.seconds, seed=told.seed)
            return _show(plant, stay=told.stay, draw_to=told.draw)
    except KeyboardInterrupt:
        print("ended; nothing is left running", file=sys.stderr)
        return 130
    finally:
        signal.signal(signal.SIGTERM, before)


def _leave(_number: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def _show(plant: Plant, *, stay: bool, draw_to: Path | None) -> int:
    begun_s = time.monotonic()
    _wait(plant, "all boards are tested", plant.tested)
    written = plant.written()
    _wait(plant, f"{sum(written.values())} records are stored", lambda: plant.stored() == written)
    _wait(plant, "all of them are counted", lambda: plant.counted() == written)
    _wait(plant, f"the alert of {DRIFTS} is known", lambda: plant.is_known_alarmed(DRIFTS))
    plant.silence(SILENT)
    _wait(plant, f"{SILENT} is killed, and known to be silent", lambda: plant.is_known_silent(SILENT))
    print(f"after {time.monotonic() - begun_s:.0f} s:\n", flush=True)
    right = [_answer(plant, question) for question in QUESTIONS]
    print(f"\n{sum(right)} of {len(right)} answers are what was planted in {len(stations())} stations", flush=True)
    if draw_to is not None:
        for file in draw(draw_to, plant.database, plant.prometheus, LOOKED_AT):
            print(f"drawn: {file}")
    if stay:
        print(f"look: psql {plant.database.url}\n      {plant.prometheus.url}\nCtrl-C ends everything", flush=True)
        signal.pause()
    print("to look for yourself: make demo-fleet DEMO_ARGS=--stay; questions and views: doc/fleet.md")
    return 0 if all(right) else 1


def _wait(plant: Plant, words: str, come: Callable[[], bool]) -> None:
    """Wait until something is so, and say it; RuntimeError with what the processes said where it never is."""
    give_up_s = time.monotonic() + plant.seconds + PATIENCE_S
    while not come():
        plant.require_alive()
        if time.monotonic() > give_up_s:
            raise RuntimeError(f"never came to it: {words}\n{plant.last_words()}")
        time.sleep(0.2)
    print(f"  {words}", flush=True)


def _answer(plant: Plant, question: Question) -> bool:
    """Print a question with its answer; return whether it is what was planted."""
    rows: Rows
    if question.engine == "PostgreSQL":
        rows = ask(plant.database, question.query)
    else:
        rows = [(labels.get("station", ""), value) for labels, value in plant.prometheus.ask(question.query)]
    right = question.holds(rows)
    said = question.say(rows) if rows else "nothing"
    print(f"{question.words}?\n    {said}{'' if right else '   NOT WHAT WAS PLANTED'}", flush=True)
    return right


if __name__ == "__main__":
    sys.exit(main())
