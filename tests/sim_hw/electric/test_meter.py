"""The simulated meter: its words, its time, its ranges, and what it says of leads that are drawn."""

import math
import statistics
from collections.abc import Mapping, Sequence
from typing import Any

import pytest

from sim_hw.electric.functions import OVERLOAD
from sim_hw.electric.meter import IDENTITY, Meter, Time
from sim_hw.plant.faults import Faults
from sim_hw.plant.knobs import Knobs

OPEN = "+9.90000000E+37"


class Drawn:
    """Leads with figures of their own."""

    def __init__(self) -> None:
        self.ohm, self.farad, self.volt, self.steady_s = 10.0, 2.5e-11, math.inf, 0.0
        self.asked: list[tuple[tuple[int, ...], float]] = []
        self.volts: list[float] = []

    def ohms(self, channels: Sequence[int], t_s: float) -> float:
        self.asked.append((tuple(channels), t_s))
        return self.ohm

    def farads(self, channels: Sequence[int], t_s: float) -> float:
        self.asked.append((tuple(channels), t_s))
        return self.farad

    def diode_v(self, channels: Sequence[int], t_s: float) -> float:
        self.asked.append((tuple(channels), t_s))
        return self.volt

    def apply_voltage(self, volts: float, t_s: float) -> None:
        assert t_s >= 0.0
        self.volts.append(volts)

    def steady_since_s(self, t_s: float) -> float:
        return min(self.steady_s, t_s)


class Bench:
    """A meter on drawn leads, with a clock that only it moves on."""

    def __init__(self, **knobs: Any) -> None:
        self.t_s = 1.0
        self.leads, self.faults = Drawn(), Faults()
        self.log: list[Mapping[str, object]] = []
        given = Knobs()
        for name, value in knobs.items():
            given = given.with_value(name, value)
        self.meter = Meter(
            self.leads, Time(lambda: self.t_s, self._until), self.faults, lambda: given, self._note, seed=1
        )

    async def _until(self, t_s: float) -> None:
        self.t_s = max(self.t_s, t_s)

    def _note(self, t_s: float, event: str, facts: Mapping[str, object]) -> None:
        assert event == "read"
        self.log.append({"t_s": t_s, **facts})

    async def ask(self, message: str) -> str:
        answer = await self.meter.answer(message)
        assert answer is not None, message
        return answer

    async def value(self, message: str) -> float:
        return float(await self.ask(message))


@pytest.fixture
def bench() -> Bench:
    return Bench()


async def test_it_says_who_it_is_and_is_done(bench: Bench) -> None:
    assert await bench.ask("*IDN?") == IDENTITY
    assert await bench.ask("*OPC?;*STB?;:SYST:VERS?") == "1;0;1999.0"
    assert await bench.meter.answer("*RST;*CLS;*WAI") is None


async def test_what_it_does_not_know_is_in_its_error_queue_and_not_answered(bench: Bench) -> None:
    for message, code in (
        ("CONF:OHMS", -113), ("READ", -113), ("*IDN? 1", -108), ("RES:NPLC", -109), ("RES:NPLC ten", -104),
        ("CONF:RES 1E12", -222), ("CONF:RES 5 V", -131), ("FETC?", -230), ("CONF:DIOD 1", -108), ("ROUT:CLOS 5", -102),
    ):  # fmt: skip
        assert await bench.meter.answer(message) is None, message
        assert (await bench.ask("SYST:ERR?")).startswith(f"{code},"), message
        assert await bench.ask("SYST:ERR?") == '+0,"No error"'


async def test_a_reading_takes_its_integration_time_and_is_logged_with_the_truth(bench: Bench) -> None:
    await bench.meter.answer("CONF:RES 100")
    await bench.meter.answer("RES:NPLC 10")
    assert await bench.value("READ?") == pytest.approx(10.15, abs=0.01)
    assert bench.t_s == pytest.approx(1.0 + 10 * 0.02, abs=0.01)
    (read,) = bench.log
    assert (read["function"], read["channels"]) == ("RES", [])
    assert read["true"] == pytest.approx(10.15)
    assert read["said"] == pytest.approx(10.15, abs=0.01)


async def test_leads_count_with_two_wires_and_not_with_four() -> None:
    bench = Bench(meter_lead_ohm=3.0)
    assert await bench.value("MEAS:RES?") == pytest.approx(13.0, abs=0.02)
    assert await bench.value("MEAS:FRES?") == pytest.approx(9.98, abs=0.02)
    assert await bench.value("MEAS:CONT?") == pytest.approx(13.0, abs=0.2)


async def test_a_range_is_good_for_a_fifth_more_and_then_overloads(bench: Bench) -> None:
    for ohm, message, overload in (
        (119.0, "MEAS:RES? 100", False),
        (121.0, "MEAS:RES? 100", True),
        (121.0, "MEAS:RES?", False),
    ):
        bench.leads.ohm = ohm
        assert (await bench.ask(message) == OPEN) == overload
    bench.leads.ohm = math.inf
    assert await bench.ask("MEAS:RES? AUTO") == OPEN
    assert bench.log[-1]["true"] is bench.log[-1]["said"] is None


async def test_noise_is_of_the_range_and_smaller_with_more_cycles(bench: Bench) -> None:
    spread = {}
    for nplc in (0.02, 1.0, 100.0):
        await bench.meter.answer("CONF:RES 100")
        await bench.meter.answer(f"RES:NPLC {nplc}")
        spread[nplc] = statistics.stdev([await bench.value("READ?") for _ in range(200)])
    assert spread[0.02] > 3 * spread[1.0] > 9 * spread[100.0]
    assert spread[1.0] == pytest.approx(2e-3, rel=0.3)


async def test_a_contact_that_bounced_while_it_measured_is_open(bench: Bench) -> None:
    bench.leads.steady_s = 1.01
    assert await bench.ask("MEAS:RES? 100") == OPEN
    assert await bench.value("READ?") < 11.0, "the next one began after the bounce"


async def test_functions_measure_what_they_are_for(bench: Bench) -> None:
    assert await bench.ask("MEAS:CAP?") == OPEN, "10 ohm leak too much"
    bench.leads.ohm = math.inf
    assert await bench.value("MEAS:CAP?") == pytest.approx(2.5e-11, rel=0.05)
    assert await bench.ask("MEAS:DIOD?") == OPEN
    bench.leads.volt = 0.61
    assert await bench.value("MEAS:DIOD?") == pytest.approx(0.61, abs=1e-3)
    assert abs(await bench.value("MEAS:VOLT:DC?")) < 1e-4


async def test_ohms_put_their_open_voltage_across_the_contact_and_volts_none() -> None:
    bench = Bench(meter_open_v=0.02)
    for message in ("MEAS:RES?", "MEAS:DIOD?", "MEAS:VOLT?", "MEAS:CAP?"):
        await bench.ask(message)
    assert bench.leads.volts == [0.02, 5.0, 0.0, 0.0]


async def test_the_scanner_closes_opens_and_is_open_after_a_reset(bench: Bench) -> None:
    await bench.meter.answer("ROUT:CLOS (@1,101:103)")
    await bench.meter.answer("ROUT:OPEN (@102)")
    assert await bench.ask("ROUT:CLOS?") == "(@1,101,103)"
    await bench.ask("MEAS:RES?")
    assert bench.leads.asked[-1][0] == (1, 101, 103)
    await bench.meter.answer("*RST")
    assert await bench.ask("ROUT:CLOS?") == "(@)"


async def test_a_relay_that_welded_is_closed_and_the_instrument_does_not_know(bench: Bench) -> None:
    bench.faults.switch("relay_welded", on=True, channel=7)
    await bench.meter.answer("CONF:RES 100;:ROUT:OPEN:ALL")
    await bench.ask("READ?")
    assert await bench.ask("ROUT:CLOS?") == "(@)"
    assert bench.leads.asked[-1][0] == (7,)
    assert bench.log[-1]["channels"] == [7]


async def test_initiate_measures_and_fetch_says_it_again(bench: Bench) -> None:
    await bench.meter.answer("CONF:RES 100;:INIT")
    assert await bench.ask("FETC?") == await bench.ask("FETC?")
    assert len(bench.log) == 1


async def test_a_meter_that_is_slow_takes_longer_and_a_stuck_one_says_the_same(bench: Bench) -> None:
    bench.faults.switch("meter_slow", on=True, delay_s=4.0, count=1)
    await bench.ask("MEAS:RES?")
    assert bench.t_s > 5.0
    before = await bench.ask("READ?")
    bench.faults.switch("meter_stuck", on=True)
    bench.leads.ohm = 5_000.0
    assert await bench.ask("READ?") == before
    for at, value in (("zero", 0.0), ("overload", OVERLOAD)):
        bench.faults.switch("meter_stuck", on=True, at=at)
        assert await bench.value("READ?") == value
    bench.faults.switch("meter_stuck", on=False)
    assert await bench.value("READ?") == pytest.approx(5_000.0, rel=0.01)


async def test_another_dialect_says_the_same_in_other_letters(bench: Bench) -> None:
    bench.faults.switch("meter_dialect", on=True, dialect="terse")
    said = await bench.ask("MEAS:RES? 100")
    assert len(said) < len(OPEN)
    assert float(said) == pytest.approx(10.15, abs=0.01)
    bench.leads.ohm = math.inf
    assert await bench.ask("READ?") == "OL"
    await bench.meter.answer("CONF:OHMS")
    assert await bench.ask("SYST:ERR?") == "-113,Undefined header"
    assert await bench.ask("SYST:ERR?") == "0,No error"
    assert await bench.ask("*IDN?") == IDENTITY


async def test_an_instrument_that_is_no_meter_knows_its_name_and_no_function(bench: Bench) -> None:
    bench.faults.switch("meter_dialect", on=True)
    assert await bench.ask("*IDN?;*OPC?") == f"{IDENTITY};1"
    for message in ("CONF:RES 100", "ROUT:CLOS (@101)", "READ?", "MEAS:RES?"):
        assert await bench.meter.answer(message) is None, message
        assert (await bench.ask("SYST:ERR?")).startswith("-113,"), message
    assert bench.log == []
