"""The driver of SCPI instruments and the simulated station's meter, over TCP and a pty: two readings of the same rules.

The needle stands pressed on TP5 from the start; no daemon and no motion is needed.
"""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from daemon.config.sections.meter import MeterSection
from daemon.station.devices import meter_settings
from daemon.tools.demo.processes import DemoBench, Process
from drivers.deadline import Deadline
from drivers.errors import MeterError, MeterTimeout, MeterTrouble
from drivers.meter import Method, ScpiMeter
from tests.sim_hw.electric.rig import STILL, TOUCH_Z_UM, demo_board, start_over
from tests.station.rig import DEMO_BOARD

NET, OTHER = "DATA2", "CLK"
CONTACT = 1


@dataclass
class Standing:
    """A simulated station whose needle is down."""

    ready: dict[str, Any]
    bench: DemoBench
    truth: Path

    def channel(self, net: str) -> int:
        harness = self.bench.ask("circuit")["harness"]
        return next(int(channel) for channel, name in harness.items() if name == net)

    def reads(self) -> list[dict[str, Any]]:
        events = (json.loads(line) for line in self.truth.read_text().splitlines())
        return [event for event in events if event["event"] == "read"]

    def fault(self, name: str, *, on: bool, **parameters: Any) -> None:
        self.bench.ask("fault", name=name, on=on, **parameters)

    def knob(self, name: str, value: float) -> None:
        self.bench.ask("set", name=name, value=value)


@pytest.fixture(scope="module")
def standing(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Standing]:
    out = tmp_path_factory.mktemp("sim")
    pad = demo_board().target("TP5")
    knobs = {**STILL, **start_over(pad.x_mm, pad.y_mm), "z_start_um": TOUCH_Z_UM - 300.0, "harness_ohm": 0.4}
    process = Process(
        "simulated station",
        [
            "sim_hw", "--board", str(DEMO_BOARD), "--line", str(out / "line"), "--camera", f"ipc://{out}/camera",
            "--bench", f"ipc://{out}/bench", "--truth", str(out / "truth.jsonl"),
            *(word for name, value in knobs.items() for word in ("--set", f"{name}={value}")),
        ],
        out / "sim.log",
        ready_line=True,
    )  # fmt: skip
    try:
        ready = process.ready()
        bench = DemoBench(ready["bench"])
        yield Standing(ready, bench, out / "truth.jsonl")
        bench.close()
    finally:
        process.end()


@pytest.fixture(params=["meter", "meter_pty"])
async def meter(request: pytest.FixtureRequest, standing: Standing) -> AsyncIterator[ScpiMeter]:
    """The instrument by either wire, as a station's configuration would have it."""
    section = MeterSection.model_validate(
        {
            "kind": "scpi", "address": standing.ready[request.param], "answer_ms": 5000,
            "methods": {"contact": {"range": 100.0, "nplc": 0.2}, "resistance": {"range": 100.0, "nplc": 1}},
        }
    )  # fmt: skip
    opened = await ScpiMeter.open(meter_settings(section), Deadline.after(30.0))
    yield opened
    await opened.close()


@pytest.fixture
def soon() -> Deadline:
    return Deadline.after(60.0)


async def test_every_method_of_the_driver_is_understood_by_the_meter(meter: ScpiMeter, soon: Deadline) -> None:
    assert meter.identity.model == "SIM-6500"
    units = [(await meter.measure(method, soon)).unit for method in Method]
    assert units == ["ohm", "ohm", "ohm", "ohm", "V", "V", "F"]


async def test_contact_is_proved_and_the_net_below_the_needle_is_read_and_no_other(
    meter: ScpiMeter, standing: Standing, soon: Deadline
) -> None:
    await meter.connect((CONTACT,), soon)
    contact = await meter.measure(Method.CONTACT, soon)
    assert 0.1 < contact.value < 0.5
    assert not contact.overload
    await meter.connect((standing.channel(NET),), soon)
    own = await meter.measure(Method.RESISTANCE, soon)
    read = standing.reads()[-1]
    assert (read["function"], read["channels"]) == ("RES", [standing.channel(NET)])
    assert own.value == pytest.approx(read["true"], abs=0.02)
    assert own.value == pytest.approx(0.4 + 0.15 + 0.02 + 0.01, abs=0.05), "harness, leads, pin, constriction"
    await meter.connect((standing.channel(OTHER),), soon)
    assert (await meter.measure(Method.RESISTANCE, soon)).overload


async def test_of_a_broken_net_contact_is_still_proved(meter: ScpiMeter, standing: Standing, soon: Deadline) -> None:
    standing.knob("open_share", 1.0)
    try:
        assert NET in standing.bench.ask("circuit")["open_nets"]
        await meter.connect((CONTACT,), soon)
        assert (await meter.measure(Method.CONTACT, soon)).value < 0.5
    finally:
        standing.knob("open_share", 0.0)


async def test_a_silent_meter_is_silent_and_then_reads_again(
    meter: ScpiMeter, standing: Standing, soon: Deadline
) -> None:
    await meter.prepare(Method.RESISTANCE, soon)
    standing.fault("meter_silent", on=True)
    with pytest.raises(MeterTimeout) as caught:
        await meter.measure(Method.RESISTANCE, Deadline.after(0.3))
    standing.fault("meter_silent", on=False)
    assert caught.value.trouble is MeterTrouble.SILENT
    assert (await meter.measure(Method.RESISTANCE, soon)).unit == "ohm"


async def test_garbage_is_no_reading(meter: ScpiMeter, standing: Standing, soon: Deadline) -> None:
    await meter.prepare(Method.RESISTANCE, soon)
    standing.fault("meter_garbage", on=True, count=1)
    with pytest.raises(MeterError) as caught:
        await meter.measure(Method.RESISTANCE, soon)
    assert caught.value.trouble is MeterTrouble.GARBAGE
    assert (await meter.measure(Method.RESISTANCE, soon)).unit == "ohm"


async def test_a_slow_meters_answer_is_not_taken_for_the_next_points(
    meter: ScpiMeter, standing: Standing, soon: Deadline
) -> None:
    """The late one is of the coupled net, the next one of an open one."""
    await meter.connect((standing.channel(NET),), soon)
    await meter.prepare(Method.RESISTANCE, soon)
    standing.fault("meter_slow", on=True, delay_s=1.0, count=1)
    with pytest.raises(MeterTimeout):
        await meter.measure(Method.RESISTANCE, Deadline.after(0.2))
    await meter.connect((standing.channel(OTHER),), soon)
    assert (await meter.measure(Method.RESISTANCE, soon)).overload


async def test_a_stuck_meter_says_the_same_of_another_net(meter: ScpiMeter, standing: Standing, soon: Deadline) -> None:
    await meter.connect((standing.channel(NET),), soon)
    before = await meter.measure(Method.RESISTANCE, soon)
    standing.fault("meter_stuck", on=True)
    await meter.connect((standing.channel(OTHER),), soon)
    stuck = await meter.measure(Method.RESISTANCE, soon)
    standing.fault("meter_stuck", on=False)
    assert stuck.value == before.value
    assert standing.reads()[-1]["true"] is None


async def test_short_numbers_and_words_for_an_overload_are_understood(
    meter: ScpiMeter, standing: Standing, soon: Deadline
) -> None:
    standing.fault("meter_dialect", on=True, dialect="terse")
    try:
        await meter.connect((standing.channel(NET),), soon)
        assert 0.4 < (await meter.measure(Method.RESISTANCE, soon)).value < 1.0
        await meter.connect((standing.channel(OTHER),), soon)
        assert (await meter.measure(Method.RESISTANCE, soon)).overload
        assert (await meter.measure(Method.CONTACT, soon)).overload
    finally:
        standing.fault("meter_dialect", on=False)


async def test_an_instrument_that_is_no_meter_is_told_from_one(
    meter: ScpiMeter, standing: Standing, soon: Deadline
) -> None:
    standing.fault("meter_dialect", on=True, dialect="foreign")
    try:
        with pytest.raises(MeterError, match="does not know the commands") as caught:
            await meter.measure(Method.RESISTANCE, soon)
        assert caught.value.trouble is MeterTrouble.DIALECT
    finally:
        standing.fault("meter_dialect", on=False)
    assert (await meter.measure(Method.RESISTANCE, soon)).unit == "ohm"
