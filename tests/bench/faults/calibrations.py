"""Kills during calibrations: the daemon is ended as by a power cut while it teaches the tip or walks the map.

Afterwards the station is taught and calibrated anew, as a person would: that has to work with whatever was left behind.
"""

from __future__ import annotations

import random
import time

from daemon.tools.demo.session import BESIDE_BOARD_UM, choose_mark
from tests.bench.faults.kills import ask_again
from tests.bench.faults.station import Station

SPAN_S = {"tip": 0.3, "map": 4.0}
"""Within so much time after the request it is killed; about what the job takes."""


def one(station: Station, chance: random.Random) -> None:
    """Kill once, and set up anew."""
    what = chance.choice(list(SPAN_S))
    station.recover()
    request = _request(station, what)
    station.send(request)
    time.sleep(chance.uniform(0.0, SPAN_S[what]))
    station.rig.daemon.kill()
    station.rig.until(lambda truth: not truth["moving"], "it goes on moving without a daemon")
    station.start()
    if left := [path.name for path in (station.rig.places.out / "station" / "calibration").rglob(".new-*")]:
        station.found("other", f"half written files are left: {left}")
    ask_again(station, [request])
    station.recover()
    station.calibrate()
    station.judge_item()


def _request(station: Station, what: str) -> dict[str, object]:
    if what == "map":
        mark = choose_mark(station.rig.board).name
        return station.request("calibrate", "map", what="map", test_point=mark)
    beside_um = [-BESIDE_BOARD_UM, station.rig.board.height_um / 2]
    station.send(station.request("place", "beside", board_um=beside_um, theta_deg=0.0, wait=True))
    return station.request("calibrate", "tip", what="tip", tip_px=station.rig.bench.ask("status")["tip_px"])
