"""One station of the demonstration: its journal filled board by board, its control socket and its figures.

`python -m tests.fleet.demo.station JSON`. Journal, operation `records` and metrics are the daemon's own and are written
in its order; what comes of a test is `planted`, for ten stations that see and move are too much for one computer.
When all boards are done it writes the number of its last record into the file `done`, and goes on answering.
"""

from __future__ import annotations

import asyncio
import json
import math
import sys
from dataclasses import asdict
from pathlib import Path
from random import Random
from typing import Any

from daemon.domain.point_test import PointReading, PointRecord, PointVerdict, Rung
from daemon.domain.results import JobResult
from daemon.maintenance.alerts import Alert
from daemon.platform.clock import utc_now
from daemon.storage.journal import Journal
from daemon.telemetry.metrics import Metrics
from tests.fleet.demo.planted import POINTS, Station, Tested, first_look_um, test_of
from tests.fleet.journal_server import serve

ALERT, ALERT_UM = "placement_error", 80.0
"""The watch that a drift raises; the daemon's own learns its limit, this one has it given."""


class Bench:
    """What a daemon writes while boards are tested."""

    def __init__(self, station: Station, journal: Journal, seed: int) -> None:
        self._station, self._journal = station, journal
        self._chance = Random(f"{seed}-{station.name}")
        self.metrics = Metrics(station.name, station.program)
        self.metrics.take("state", {"state": "idle"})
        self._alerted = False

    async def board(self, number: int, boards: int) -> None:
        """Test one board: a look with a correction, then point after point."""
        board_id, job = self._station.board_id(number), f"{self._station.name}-{number}"
        needle = self._station.needle(number, boards)
        self._journal.stream.set_circumstances({
            "program": self._station.program, "configuration": "77d0c5d0a5b1e0f2", "board": self._station.board,
            "board_side": "top", "board_revision": "0c5f0d1b9a7e4c33", "needle": needle, "tip": f"tip-{needle}",
        })  # fmt: skip
        off_um = await self._correct(f"{job}-look", board_id, number / boards)
        await self._watch(off_um)
        await self._journal.add_job(job, "run", json.dumps({"board_id": board_id}))
        for point in POINTS:
            await self._point(job, board_id, test_of(self._station, point, self._chance))
        await self._finish(JobResult(**self._facts(job, "run"), ok=True, outcome="run_done"))

    async def _correct(self, job: str, board_id: str, part: float) -> float:
        """Write a correction at the first point of a board down; return what the first look found."""
        off_um = first_look_um(self._station, part, self._chance)
        await self._journal.add_job(job, "correct", json.dumps({"board_id": board_id, "test_point": POINTS[0]}))
        after_um = abs(self._chance.gauss(8.0, 3.0))
        await self._finish(
            JobResult(
                **self._facts(job, "correct"), ok=True, outcome="corrected", test_point=POINTS[0], looks=2, moves=1,
                error_before_um=off_um, error_after_um=after_um, timing_ms={"look": {"exposure": 62.0, "total": 166.0}},
                detail={"theta_deg": 45.0 * self._chance.randrange(8)},
            )
        )  # fmt: skip
        return off_um

    def _facts(self, job: str, op: str) -> dict[str, Any]:
        return {"id": job, "op": op, "seq": self._journal.take_seq(), "station": self._station.name,
                "finished_at": utc_now()}  # fmt: skip

    async def _finish(self, result: JobResult) -> None:
        await self._journal.finish_job(result)
        self.metrics.take("result", result.model_dump(mode="json"))

    async def _point(self, job: str, board_id: str, tested: Tested) -> None:
        good = tested.verdict in {PointVerdict.PASS_FIRST, PointVerdict.PASS_RECOVERED}
        value = tested.value_ohm if math.isfinite(tested.value_ohm) else None
        for n in range(tested.touches):
            rung = Rung.TOUCH if n == 0 else tested.recovered_by or Rung.SECOND_SITE
            number = await self._journal.begin_touch(job, board_id, tested.point, visit=job, rung=rung.value)
            read = value if good and n == tested.touches - 1 else None
            facts = {"z_end_um": 4700.0, "pressed_um": 300.0, "force_n": 0.48, "proof": 1, "value": read, "unit": "ohm"}
            await self._journal.tell_touch(number, facts)
            await self._journal.tell_touch(number, {"ended_by": "lifted"})
            self.metrics.report(None, 1)
        reading = PointReading(
            rung=Rung.TOUCH, site_um=(0.0, 0.0), pressed_um=300.0, force_n=0.48, proof=True, value=value,
            overload=value is None, unit="ohm",
        )  # fmt: skip
        record = PointRecord(
            point=tested.point, net=f"NET{tested.point[2:]}", board_id=board_id, method="continuity", limits=None,
            verdict=tested.verdict, run=job, recovered_by=tested.recovered_by, cause=tested.cause, readings=(reading,),
            touches=tested.touches, presses=tested.touches, seconds=1.2 * tested.touches, at=utc_now(),
        )  # fmt: skip
        await self._journal.add_point(job, record)

    async def _watch(self, off_um: float) -> None:
        """Raise an alert once the misses are beyond the limit."""
        if off_um < ALERT_UM or self._alerted:
            return
        self._alerted = True
        now = utc_now()
        alert = Alert(
            name=ALERT, group="placement", what="how far the tip lands from the pad before it is corrected",
            severity="warning", figure=off_um, usual=20.0, limit=ALERT_UM, unit="um", rule="mean", since_touches=0,
            since_at=now, evidence=(), advice="calibrate rotation and map again", raised_at=now, updated_at=now,
        )  # fmt: skip
        await self._journal.set_standing(ALERT, alert.to_dict())
        await self._journal.add_alert(self._journal.take_seq(), alert.body("raised"))
        self.metrics.take("alert", alert.body("raised"))


async def work(told: dict[str, Any]) -> None:
    """Test the boards, then answer until ended."""
    station, folder, boards = Station(**told["station"]), Path(told["folder"]), int(told["boards"])
    journal = await Journal.open(folder / "journal.sqlite")
    await journal.reserve_seqs()
    bench = Bench(station, journal, told["seed"])
    bench.metrics.serve(told["metrics_port"])
    answering = asyncio.create_task(serve(journal, station.name, told["endpoint"], station.program))
    for number in range(boards):
        await bench.board(number, boards)
        await journal.reserve_seqs()
        await asyncio.sleep(told["seconds"] / boards)
    last = (await journal.stream.read(None, 0, 1)).next_seq - 1
    (folder / "done.new").write_text(str(last))
    (folder / "done.new").rename(folder / "done")
    await answering


def arguments(
    station: Station, folder: Path, endpoint: str, *, metrics_port: int, boards: int, seconds: float, seed: int
) -> str:
    """Return how a station is started."""
    told = {"station": asdict(station), "folder": str(folder), "endpoint": endpoint, "metrics_port": metrics_port,
            "boards": boards, "seconds": seconds, "seed": seed}  # fmt: skip
    return json.dumps(told)


if __name__ == "__main__":
    asyncio.run(work(json.loads(sys.argv[1])))
