"""Whatever is wrong at once, with board, needle, way, scanner and harness: no verdict says what is not so.

Each case is drawn from its number, and its points are tested one after the other as those of a board are.
"""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.point_test import PASSES, PointRecord, PointVerdict
from tests.daemon.procedures.fake_probing import CHANNELS, INF, KELVIN, RADIUS_UM, Line

CASES = 24
POINTS = ("B", "A", "S", "B2")
GROUND, CLAMP_V = "NB", 0.6
ASKED: dict[str, dict[str, Any]] = {
    "continuity": {},
    "resistance": {"limits": {"high": 0.5, "unit": "ohm"}},
    "diode": {"limits": {"low": 0.4, "high": 0.8, "unit": "V"}},
}
ENDS_IT_ALL = (FaultCode.PROBE_BAD, FaultCode.CONTACT_BEFORE_DESCENT)


class Trouble:
    """One case: a station with what is wrong of it, and where the needle stood when a point's value was read last."""

    def __init__(self, line: Line, number: int) -> None:
        self.line, self._random = line, random.Random(f"trouble/{number}")
        rng, nets = self._random, list(CHANNELS)
        self.said = f"case {number}"
        line.open_nets = {net for net in nets if rng.random() < 0.3}
        line.harness_open = {channel for channel in CHANNELS.values() if rng.random() < 0.1}
        if rng.random() < 0.5:
            any_two = set(rng.sample(sorted(CHANNELS.values()), 2))
            line.joined_wires.append(any_two if rng.random() < 0.3 else {102, 104})
        for pad in POINTS:
            if rng.random() < 0.2:
                line.films[pad] = (rng.choice([2, 3, 99]), rng.choice([4.0, 300.0, INF]))
        if rng.random() < 0.1:
            line.debris_ohm = 5_000.0
        self._welded = rng.choice([KELVIN, *CHANNELS.values()]) if rng.random() < 0.3 else None
        self._measured, self._welds_at = 0, rng.randrange(80)
        self.stood_on: str | None = None
        self._true_ohm, line.meter.says = line.meter.true_ohm, self._says
        meter = line.world.context.config.meter
        assert meter is not None
        line.without(meter=meter.model_copy(update={"ground_net": GROUND}))

    def _says(self) -> float:
        self._measured += 1
        if self._welded is not None and self._measured == self._welds_at:
            self.line.meter.stuck_channels = (self._welded,)
        if self.line.is_down and KELVIN not in self.line.meter.channels[:1]:
            self.stood_on = self.line.stands_on()
        ohm = self._true_ohm()
        return self._diode_v(ohm) if self.line.meter.asked[-1] == "diode" else ohm

    def _diode_v(self, ohm: float) -> float:
        """Return what the diode test reads: a clamp from each net to ground, but where a current flows past it."""
        line, channel = self.line, CHANNELS[GROUND]
        whole = channel in line.meter.channels and channel not in line.harness_open
        return ohm if line.stands_on() in (None, "coin") or ohm < 1.0 or not whole else CLAMP_V + line.film_ohm() * 1e-3

    def miss(self) -> None:
        """Have the next way end beside its place now and then: on mask, or on the neighbour."""
        aside = self._random.choice([(0.0, 0.0), (0.0, 0.0), (RADIUS_UM + 60.0, 0.0), (0.0, 720.0), (0.0, -720.0)])
        self.line.misses_um = [aside]

    def method(self, point: str) -> str:
        """Draw what is asked of a point; ground's own are not held against ground."""
        return self._random.choice(["continuity", "continuity", "resistance", *(["diode"] if point in "AS" else [])])

    def is_sound(self, point: str, net: str) -> bool:
        """Whether a pad reaches the harness' pin of its net."""
        return net not in self.line.open_nets or point in self.line.whole


@pytest.mark.parametrize("number", range(CASES))
async def test_no_verdict_is_wrong(number: int, tmp_path: Path) -> None:
    line = Line(tmp_path)
    trouble = Trouble(line, number)
    for point in POINTS:
        trouble.miss()
        record = await _probe(line, point, trouble.method(point))
        if record is None:
            return
        _see_it_is_so(trouble, record)


async def _probe(line: Line, point: str, method: str) -> PointRecord | None:
    """Return what came of a point; None where needle or scanner are too bad for any other."""
    try:
        return await line.probe(point, job_id=point, method=method, **ASKED[method])
    except Fault as fault:
        if fault.kind not in ENDS_IT_ALL:
            raise
        line.see_rules_kept()
        return None


def _see_it_is_so(trouble: Trouble, record: PointRecord) -> None:
    net = record.net or ""
    # Broken or not, what lies between a net and ground is there in all of these cases.
    sound = record.method == "diode" or trouble.is_sound(record.point, net)
    if record.verdict in PASSES:
        stood_on = next(one.net for one in trouble.line.world.pads if one.name == trouble.stood_on)
        assert (sound, stood_on) == (True, net), f"{trouble.said}: {record}"
    elif record.verdict in (PointVerdict.OPEN_CONFIRMED, PointVerdict.FAIL):
        assert not sound, f"{trouble.said}: {record}"
