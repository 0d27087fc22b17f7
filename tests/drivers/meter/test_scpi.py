"""The driver of SCPI instruments against raw bytes: what it says, what it believes, how it gets in step again."""

import asyncio
import contextlib
import math
import socket
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest

from drivers.deadline import Deadline
from drivers.errors import MeterError, MeterTimeout, MeterTrouble
from drivers.meter import (
    DEFAULT_FUNCTIONS,
    Function,
    MeterSettings,
    Method,
    MethodSettings,
    ScpiMeter,
    SerialAddress,
    TcpAddress,
)
from tests.drivers.peers.instrument import IDENTITY, Instrument, PtyPeer, Script, TcpPeer

METHODS = {method: MethodSettings(function) for method, function in DEFAULT_FUNCTIONS.items()}
METHODS[Method.RESISTANCE] = MethodSettings(Function.RESISTANCE, range=100.0, nplc=0.2)
Open = Callable[..., Awaitable[ScpiMeter]]
WIRES = ("tcp", "pty")


@pytest.fixture
def script() -> Script:
    return Script()


@pytest.fixture(params=WIRES)
async def peer(request: pytest.FixtureRequest, script: Script, tmp_path: Path) -> AsyncIterator[TcpPeer | PtyPeer]:
    instrument = Instrument(script)
    made: TcpPeer | PtyPeer = TcpPeer(instrument) if request.param == "tcp" else PtyPeer(instrument, tmp_path / "meter")
    yield made
    await made.close()


@pytest.fixture
async def open_meter(peer: TcpPeer | PtyPeer, soon: Deadline) -> AsyncIterator[Open]:
    meters: list[ScpiMeter] = []

    async def open_(**settings: Any) -> ScpiMeter:
        address = await peer.open()
        given: dict[str, Any] = {"answer_s": 10.0, "methods": METHODS, **settings}
        meters.append(await ScpiMeter.open(MeterSettings(address, **given), soon))
        return meters[-1]

    yield open_
    for meter in meters:
        await meter.close()


async def test_opening_learns_who_it_is_and_brings_it_into_a_known_state(
    open_meter: Open, peer: TcpPeer | PtyPeer
) -> None:
    meter = await open_meter(setup=("SYST:REM",))
    assert (meter.identity.maker, meter.identity.model, meter.identity.serial) == ("ACME", "DMM-7", "SN123")
    assert str(meter.identity) == "ACME DMM-7"
    assert peer.instrument.told == [
        b"*CLS", b"*IDN?", b"SYST:REM", b"*RST", b"*CLS", b"SYST:REM", b"SYST:ERR?",
    ]  # fmt: skip


async def test_a_set_up_that_a_reset_undoes_is_said_again_after_it(
    open_meter: Open, peer: TcpPeer | PtyPeer, script: Script, soon: Deadline
) -> None:
    """After *RST it answers READ? with five values, as makers of sourcing meters do; FORM:ELEM asks for the one."""
    elements: list[bytes] = []

    def knows(command: bytes) -> bool:
        if command == b"*RST":
            elements[:] = [b"VOLT", b"CURR", b"RES", b"TIME", b"STAT"]
        if command.startswith(b"FORM:ELEM "):
            elements[:] = command.removeprefix(b"FORM:ELEM ").split(b",")
        script.reading = (b",".join([b"+1.50000000E+01"] * len(elements)) + b"\n",)
        return True

    script.knows = knows
    meter = await open_meter(setup=("FORM:ELEM RES",))
    assert (await meter.measure(Method.RESISTANCE, soon)).value == 15.0


async def test_a_set_up_that_the_instrument_does_not_know_is_an_error_at_the_opening(
    open_meter: Open, script: Script
) -> None:
    script.knows = lambda command: command != b"NO:SUCH:COMMAND"
    with pytest.raises(MeterError, match="set-up"):
        await open_meter(setup=("NO:SUCH:COMMAND",))


async def test_it_is_set_up_once_and_then_only_read(open_meter: Open, peer: TcpPeer | PtyPeer, soon: Deadline) -> None:
    meter = await open_meter()
    told = peer.instrument.told
    told.clear()
    await meter.prepare(Method.RESISTANCE, soon)
    readings = [await meter.measure(Method.RESISTANCE, soon) for _ in range(2)]
    assert [(one.value, one.unit, one.overload) for one in readings] == [(15.0, "ohm", False)] * 2
    assert readings[0].at_s < readings[1].at_s
    assert told == [b"CONF:RES 100", b"RES:NPLC 0.2", b"SYST:ERR?", b"READ?", b"READ?"]
    told.clear()
    assert (await meter.measure(Method.VOLTAGE, soon)).unit == "V"
    assert told == [b"CONF:VOLT:DC", b"SYST:ERR?", b"READ?"]


@pytest.mark.parametrize(("terminator", "end"), [("lf", b""), ("crlf", b"\r")])
async def test_commands_end_as_configured(
    open_meter: Open, peer: TcpPeer | PtyPeer, terminator: str, end: bytes
) -> None:
    await open_meter(terminator=terminator)
    assert peer.instrument.told[1] == b"*IDN?" + end


async def test_an_overload_is_infinite_and_no_error(open_meter: Open, script: Script, soon: Deadline) -> None:
    meter = await open_meter()
    script.reading = (b"+9.90000000E+37\n",)
    reading = await meter.measure(Method.RESISTANCE, soon)
    assert (reading.value, reading.overload) == (math.inf, True)


async def test_an_answer_in_pieces_is_put_together(open_meter: Open, script: Script, soon: Deadline) -> None:
    meter = await open_meter()
    script.reading = (b"+1.", 0.01, b"25E+00", 0.01, b"\r\n")
    assert (await meter.measure(Method.RESISTANCE, soon)).value == 1.25


async def test_a_late_answer_is_never_taken_for_the_next_ones(open_meter: Open, script: Script, soon: Deadline) -> None:
    """An instrument that integrates longer than it is waited for: 1 ohm was of another point."""
    meter = await open_meter()
    await meter.prepare(Method.RESISTANCE, soon)
    script.reading = (0.5, b"+1.0E+00\n")
    with pytest.raises(MeterTimeout, match="no answer to READ"):
        await meter.measure(Method.RESISTANCE, Deadline.after(0.2))
    script.reading = (b"+7.0E+03\n",)
    assert (await meter.measure(Method.RESISTANCE, soon)).value == 7000.0


async def test_one_that_cannot_be_brought_in_step_is_opened_anew(
    open_meter: Open, peer: TcpPeer | PtyPeer, script: Script, soon: Deadline
) -> None:
    """It lost power in the middle: it says nothing more on this connection, and is sound on the next."""
    meter = await open_meter()
    await meter.prepare(Method.RESISTANCE, soon)
    script.reading, script.silent = (), True
    for _ in range(2):
        with pytest.raises(MeterTimeout):
            await meter.measure(Method.RESISTANCE, Deadline.after(0.2))
    script.reading, script.silent = (b"+7.0E+03\n",), False
    peer.instrument.told.clear()
    assert (await meter.measure(Method.RESISTANCE, soon)).value == 7000.0
    assert b"*RST" in peer.instrument.told


async def test_after_a_late_answer_the_next_time_out_says_that_it_is_slow(
    open_meter: Open, peer: TcpPeer | PtyPeer, script: Script, soon: Deadline
) -> None:
    meter = await open_meter()
    await meter.prepare(Method.RESISTANCE, soon)
    script.reading = (0.2, b"+1.0E+00\n")
    for expected in (MeterTrouble.SILENT, MeterTrouble.SLOW):
        with pytest.raises(MeterTimeout) as caught:
            await meter.measure(Method.RESISTANCE, Deadline.after(0.1))
        assert caught.value.trouble is expected
        await asyncio.sleep(0.3)
        await meter.check(soon)
    assert "NPLC" in caught.value.advice


async def test_a_cancelled_question_leaves_no_answer_behind(
    open_meter: Open, peer: TcpPeer | PtyPeer, script: Script, soon: Deadline
) -> None:
    meter = await open_meter()
    await meter.prepare(Method.RESISTANCE, soon)
    script.reading = (0.1, b"+1.0E+00\n")
    peer.instrument.told_one.clear()
    asking = asyncio.create_task(meter.measure(Method.RESISTANCE, soon))
    await peer.instrument.told_one.wait()
    asking.cancel()
    with pytest.raises(asyncio.CancelledError):
        await asking
    await asyncio.sleep(0.2)
    script.reading = (b"+2.0E+00\n",)
    assert (await meter.measure(Method.RESISTANCE, soon)).value == 2.0


async def test_two_who_ask_at_once_are_answered_in_turn(open_meter: Open, script: Script, soon: Deadline) -> None:
    meter = await open_meter()
    script.reading = (0.02, b"+3.0E+00\n")
    both = await asyncio.gather(meter.measure(Method.RESISTANCE, soon), meter.measure(Method.CAPACITANCE, soon))
    assert [one.unit for one in both] == ["ohm", "F"]


async def test_a_silent_instrument_is_given_up_at_its_deadline(
    open_meter: Open, script: Script, soon: Deadline
) -> None:
    meter = await open_meter()
    await meter.prepare(Method.RESISTANCE, soon)
    script.reading = ()
    with pytest.raises(MeterTimeout) as caught:
        await meter.measure(Method.RESISTANCE, Deadline.after(0.1))
    assert caught.value.trouble is MeterTrouble.SILENT
    assert isinstance(caught.value, TimeoutError)


async def test_without_time_left_nothing_is_asked_and_it_stays_in_step(
    open_meter: Open, peer: TcpPeer | PtyPeer, soon: Deadline
) -> None:
    meter = await open_meter()
    await meter.prepare(Method.RESISTANCE, soon)
    peer.instrument.told.clear()
    with pytest.raises(MeterTimeout, match="no time was left"):
        await meter.measure(Method.RESISTANCE, Deadline.after(-1.0))
    await meter.measure(Method.RESISTANCE, soon)
    assert peer.instrument.told == [b"READ?"]


async def test_an_answer_without_its_end_is_a_matter_of_the_terminator(
    open_meter: Open, script: Script, soon: Deadline
) -> None:
    meter = await open_meter()
    script.reading = (b"+1.0E+00\r",)
    with pytest.raises(MeterTimeout, match=r"'\+1.0E\+00'") as caught:
        await meter.measure(Method.RESISTANCE, Deadline.after(1.0))
    assert caught.value.trouble is MeterTrouble.UNFINISHED
    assert "terminator" in caught.value.advice


@pytest.mark.parametrize(
    ("answer", "trouble"),
    [
        (b"\x80\xff\x13~\n", MeterTrouble.GARBAGE),
        (b"READ?\n", MeterTrouble.GARBAGE),
        (b"1,5E0\n", MeterTrouble.GARBAGE),
        (b"\n", MeterTrouble.GARBAGE),
        (b"+1.5 KOHM\n", MeterTrouble.DIALECT),
        (b"+1.5E0 V\n", MeterTrouble.DIALECT),
        (b"+9.91E37\n", MeterTrouble.INVALID),
        (b"x" * 70_000, MeterTrouble.GARBAGE),
    ],
)
async def test_what_is_no_number_is_no_reading_and_the_next_one_is_good(
    open_meter: Open, script: Script, soon: Deadline, answer: bytes, trouble: MeterTrouble
) -> None:
    meter = await open_meter()
    # A pty's buffer takes so much at once.
    script.reading = [piece for i in range(0, len(answer), 1000) for piece in (answer[i : i + 1000], 0.001)]
    with pytest.raises(MeterError) as caught:
        await meter.measure(Method.RESISTANCE, soon)
    assert caught.value.trouble is trouble
    assert str(caught.value).isprintable()
    script.reading = (b"+1.5E0 OHM\n",)
    assert (await meter.measure(Method.RESISTANCE, soon)).value == 1.5


async def test_another_dialect_is_refused_by_its_error_queue(
    open_meter: Open, script: Script, peer: TcpPeer | PtyPeer, soon: Deadline
) -> None:
    script.knows = lambda command: not command.startswith(b"CONF:CAP")
    meter = await open_meter()
    with pytest.raises(MeterError, match="does not know the commands for capacitance") as caught:
        await meter.measure(Method.CAPACITANCE, soon)
    assert (caught.value.trouble, caught.value.exception) == (MeterTrouble.DIALECT, -113)
    assert caught.value.fields() == {"exception": -113, "trouble": "dialect"}
    assert b"READ?" not in peer.instrument.told
    assert (await meter.measure(Method.RESISTANCE, soon)).value == 15.0


async def test_words_of_another_dialect_can_be_configured(
    open_meter: Open, peer: TcpPeer | PtyPeer, script: Script, soon: Deadline
) -> None:
    words = MethodSettings(Function.RESISTANCE, commands=("FUNC RES", "RATE F"), read="READ?")
    meter = await open_meter(methods={Method.CONTACT: words})
    peer.instrument.told.clear()
    await meter.measure(Method.CONTACT, soon)
    assert peer.instrument.told == [b"FUNC RES", b"RATE F", b"SYST:ERR?", b"READ?"]
    with pytest.raises(MeterError, match="no set-up for diode"):
        await meter.measure(Method.DIODE, soon)


async def test_the_scanner_is_told_once_what_to_close(
    open_meter: Open, peer: TcpPeer | PtyPeer, script: Script, soon: Deadline
) -> None:
    meter = await open_meter()
    peer.instrument.told.clear()
    await meter.connect((101, 7), soon)
    await meter.connect((101, 7), soon)
    await meter.connect((), soon)
    assert peer.instrument.told == [
        b"ROUT:OPEN:ALL", b"ROUT:CLOS (@101,7)", b"SYST:ERR?", b"ROUT:OPEN:ALL", b"SYST:ERR?",
    ]  # fmt: skip
    script.knows = lambda command: not command.startswith(b"ROUT")
    with pytest.raises(MeterError, match="does not know the commands for its scanner"):
        await meter.connect((3,), soon)


async def test_who_is_no_instrument_is_told_by_its_words(open_meter: Open, script: Script) -> None:
    script.identity = b"HTTP/1.1 400 Bad Request"
    with pytest.raises(MeterError, match=r"says 'HTTP/1\.1 400 Bad Request'") as caught:
        await open_meter(answer_s=2.0)
    assert caught.value.trouble is MeterTrouble.GARBAGE


async def test_one_who_talks_without_end_is_no_instrument(open_meter: Open, script: Script) -> None:
    script.identity = b"\n".join(b"$GPGGA,%d" % number for number in range(50))
    with pytest.raises(MeterError) as caught:
        await open_meter()
    assert caught.value.trouble is MeterTrouble.GARBAGE


async def test_another_model_than_configured_is_refused(open_meter: Open) -> None:
    with pytest.raises(MeterError, match="is ACME DMM-7, not the 34461A") as caught:
        await open_meter(model="34461A")
    assert caught.value.trouble is MeterTrouble.OTHER


async def test_an_answer_left_from_before_is_not_who_it_is(open_meter: Open, script: Script) -> None:
    """A program that died while it measured: its reading is still on the way."""
    script.identity = b"+1.0E+00\n+2.0E+00\n" + IDENTITY
    assert (await open_meter()).identity.model == "DMM-7"


async def test_one_that_was_exchanged_is_noticed(open_meter: Open, script: Script, soon: Deadline) -> None:
    meter = await open_meter()
    script.identity = b"ACME,DMM-7,SN999,1.0"
    with pytest.raises(MeterError, match="SN999") as caught:
        await meter.check(soon)
    assert caught.value.trouble is MeterTrouble.OTHER


async def test_a_line_that_was_cut_is_opened_anew(open_meter: Open, peer: TcpPeer | PtyPeer, soon: Deadline) -> None:
    meter = await open_meter()
    await meter.measure(Method.RESISTANCE, soon)
    await peer.hang_up()
    if isinstance(peer, PtyPeer):
        await peer.open()
    # That it was cut may show only when it is used.
    with contextlib.suppress(MeterError):
        await meter.measure(Method.RESISTANCE, soon)
    assert (await meter.measure(Method.RESISTANCE, soon)).value == 15.0
    told = peer.instrument.told
    assert told[len(told) - told[::-1].index(b"*RST") :][:4] == [
        b"*CLS",
        b"SYST:ERR?",
        b"CONF:RES 100",
        b"RES:NPLC 0.2",
    ]


async def test_a_line_that_is_cut_while_it_is_waited_for_is_lost_at_once(
    open_meter: Open, peer: TcpPeer | PtyPeer, script: Script, soon: Deadline
) -> None:
    meter = await open_meter()
    await meter.prepare(Method.RESISTANCE, soon)
    script.reading = ()
    peer.instrument.told_one.clear()
    asking = asyncio.create_task(meter.measure(Method.RESISTANCE, soon))
    await peer.instrument.told_one.wait()
    await peer.hang_up()
    with pytest.raises(MeterError) as caught:
        await asking
    assert caught.value.trouble is MeterTrouble.LOST


# ---------------------------------------------------------------- what cannot be opened


async def _not_opened(address: TcpAddress | SerialAddress, within_s: float = 5.0) -> MeterError:
    with pytest.raises(MeterError) as caught:
        await ScpiMeter.open(MeterSettings(address, METHODS, answer_s=within_s), Deadline.after(30.0))
    return caught.value


async def test_where_nobody_listens_it_is_refused() -> None:
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))
        for host in ("127.0.0.1", "localhost"):
            error = await _not_opened(TcpAddress(host, held.getsockname()[1]))
            assert (error.trouble, error.device) == (MeterTrouble.REFUSED, "meter")


async def test_a_host_that_there_is_not_is_a_wrong_address() -> None:
    error = await _not_opened(TcpAddress("no..host", 5025))
    assert error.trouble is MeterTrouble.ADDRESS


async def test_a_service_that_may_not_reach_the_network_is_told_how_to(monkeypatch: pytest.MonkeyPatch) -> None:
    """What systemd's IPAddressDeny does to a connection."""

    async def forbidden(*_args: object, **_kwargs: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(asyncio.get_running_loop(), "create_connection", forbidden)
    error = await _not_opened(TcpAddress("127.0.0.1", 5025))
    assert error.trouble is MeterTrouble.UNREACHABLE
    assert "IPAddressAllow" in error.advice


async def test_one_that_takes_the_call_and_says_nothing_is_silent() -> None:
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        error = await _not_opened(TcpAddress("127.0.0.1", silent.getsockname()[1]), within_s=0.2)
    assert error.trouble is MeterTrouble.SILENT


async def test_a_port_that_there_is_not_or_is_none_is_a_wrong_address(tmp_path: Path) -> None:
    error = await _not_opened(SerialAddress(str(tmp_path / "none")))
    assert (error.trouble, str(error)) == (MeterTrouble.ADDRESS, f"meter: there is no {tmp_path / 'none'}")
    (tmp_path / "file").write_text("")
    assert (await _not_opened(SerialAddress(str(tmp_path / "file")))).trouble is MeterTrouble.ADDRESS


async def test_a_port_that_another_program_holds_is_busy(tmp_path: Path, soon: Deadline) -> None:
    peer = PtyPeer(Instrument(Script()), tmp_path / "meter")
    address = await peer.open()
    first = await ScpiMeter.open(MeterSettings(address, METHODS), soon)
    assert (await _not_opened(address)).trouble is MeterTrouble.BUSY
    await first.close()
    await peer.close()
