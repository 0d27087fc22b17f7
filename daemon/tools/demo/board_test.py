"""Board's test as the demonstration's tester does it: trouble is let loose, a plan stored and run, each verdict told.

The tester speaks the daemon's wire and decides nothing by itself: what is measured is the meter's, what follows from it
the ladder's. Nobody here asks the simulated station for its truth.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from daemon.client import Client, Subscription
from daemon.domain.board import Board, BoardPoint
from daemon.domain.point_test import PointRecord
from daemon.domain.results import JobResult
from daemon.tools.demo.processes import DemoBench, Process, StartError

PLAN, RUN, BOARD_ID = "demo", "demo-run", "demo-1"
HEARD_WITHIN_S = 1.0
PATIENCE_S = 3600.0
ASK_EACH_S = 5.0
"""How long nothing may be heard before the daemon is asked: an event may be lost, what the journal has is not."""
Told = Callable[[PointRecord], None]


@dataclass(frozen=True)
class Trouble:
    """What is wrong with board, ways and head, by names of the simulated station's knobs.

    The shares are several times those of a line, so that a small board has some of each.
    """

    misplaced_share: float = 0.25
    """Ways that end up to 400 um beside their place."""
    oxide_share: float = 0.12
    """Pads with a film that a press or two breaks."""
    open_share: float = 0.06
    """Nets with a broken trace."""
    head_runout_scale: float = 1.2
    """The head has drifted since it was calibrated: its run-out has grown by a fifth."""

    def let_loose(self, bench: DemoBench) -> None:
        """Make the station so; before that it is as it was calibrated."""
        for name, value in vars(self).items():
            bench.ask("set", name=name, value=value)

    @staticmethod
    def stop_leading_astray(bench: DemoBench) -> None:
        """Let ways end at their place again: who tries the station by hand would have to align without end."""
        bench.ask("set", name="misplaced_share", value=0.0)


def run_board(
    client: Client, daemon: Process, events: str, board: Board, points: Sequence[BoardPoint], told: Told
) -> JobResult:
    """Test the points by one run and return its result; `told` is called with each record as it comes."""
    named = "".join(f"\n[[point]]\npoint = {json.dumps(point.name)}\n" for point in points)
    text = f'[plan]\nboard = {json.dumps(board.name)}\n\n[defaults]\nhigh = "5 ohm"\n{named}'
    client.request("plan", action="store", name=PLAN, text=text)
    with Subscription(events, topics=("point", "result")) as heard:
        client.request("run", id=RUN, plan=PLAN, board_id=BOARD_ID, deadline_ms=PATIENCE_S * 1e3)
        quiet_since_s = time.monotonic()
        while True:
            event = heard.next(HEARD_WITHIN_S)
            if event is not None and event["topic"] == "point":
                told(PointRecord.model_validate({name: event[name] for name in PointRecord.model_fields}))
            elif event is not None and event.get("id") == RUN:
                break
            if event is not None:
                quiet_since_s = time.monotonic()
            if not daemon.alive():
                raise StartError(f"the daemon ended: {daemon.last_words()}")
            if time.monotonic() - quiet_since_s > ASK_EACH_S and client.request("result", id=RUN)["done"]:
                break
    return JobResult.model_validate(client.request("result", id=RUN)["result"])
