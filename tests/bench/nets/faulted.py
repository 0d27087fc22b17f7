"""A point's test into which a fault of the station comes: whatever it ends in, the needle has to be up after it.

No verdict that is given all the same may be a wrong one.

Only where the drives themselves are in doubt may it stay down, and then the daemon has to say so (`needle_down`).
"""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from daemon.client import Refused
from daemon.domain.board import BoardPoint
from tests.bench.nets.records import Visit
from tests.bench.nets.single import FAULTED
from tests.bench.nets.station import Tester

FAULTS: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        "sense_stuck": {"closed": True}, "meter_silent": {}, "meter_garbage": {}, "meter_slow": {"delay_s": 30.0},
        "meter_dialect": {"dialect": "foreign"}, "silent": {}, "black": {}, "dead_lamp": {"lamp": "both"}, "estop": {},
        "cable_out": {}, "stall": {"axis": "z"}, "relay_welded": {}, "harness_joined": {}, "harness_open": {},
    }
)  # fmt: skip
BEFORE = ("sense_stuck", "meter_dialect", "harness_joined")
"""Faults that are there before the test begins."""
IN_DOUBT = ("estop", "cable_out", "stall")
"""After these nobody can move the needle."""
LATEST_S, AFTER_S = 1.5, 1.0


class Faulted:
    """Breaks one station, one fault after the other."""

    def __init__(self, tester: Tester, seed: int, stop: threading.Event) -> None:
        self._tester, self._stop = tester, stop
        self._random = random.Random(f"{seed}/nets/faults")

    def test(self, point: BoardPoint, number: int) -> Visit:
        """Test a point while the fault of that number comes in; judge where the needle is one second after the end."""
        tester, bench = self._tester, self._tester.rig.bench
        name = list(FAULTS)[number % len(FAULTS)]
        asked: dict[str, Any] = {"test_point": point.name, "board_id": tester.board_id}
        job_id = f"{tester.board_id}-{name}"
        tester.forget()
        if name in BEFORE:
            bench.ask("fault", name=name, on=True, **FAULTS[name])
        try:
            tester.client.request("probe", id=job_id, **asked)
            self._stop.wait(self._random.uniform(0.0, LATEST_S))
            bench.ask("fault", name=name, on=True, **FAULTS[name])
            result = tester.operator.job(job_id, "probe", **asked)
            said = result.outcome if result.error is None else f"{result.error.name}: {result.error.message}"
        except Refused as refused:
            said = str(refused)
        time.sleep(AFTER_S / tester.speed)
        visit = replace(tester.visit(point, f"{FAULTED}{name}", said), killed=True)
        status = tester.client.request("status")
        told = status["state"] == "fault" and status["needle"]["place"] != "up"
        if name in IN_DOUBT and told:
            visit = replace(visit, pressed_after_um=0.0, height_after_um=1e9)
        bench.ask("fault", name=name, on=False)
        tester.recover()
        return visit
