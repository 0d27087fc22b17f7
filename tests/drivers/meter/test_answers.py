"""What answers say, and what addresses mean."""

import contextlib
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import MeterError
from drivers.meter import SerialAddress, TcpAddress, parse_address, parse_identity
from drivers.meter.answers import parse_error, parse_reading


@given(st.floats(min_value=-1e12, max_value=1e12))
def test_every_number_an_instrument_can_print_is_read(value: float) -> None:
    for text in (f"{value:+.8E}", f" {value:.6e}\r", f"{value:+.9E} OHM"):
        assert parse_reading(text, "ohm", 1.0).value == pytest.approx(value, rel=1e-5, abs=1e-30)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("+9.90000000E+37", math.inf),
        ("9.9E37", math.inf),
        ("9.8999995E+37", math.inf),
        ("-9.9e37", -math.inf),
        ("OL", math.inf),
        ("-OL", -math.inf),
        ("overload", math.inf),
    ],
)
def test_every_way_to_say_overload_is_one(text: str, value: float) -> None:
    reading = parse_reading(text, "ohm", 0.0)
    assert (reading.value, reading.overload) == (value, True)


@given(st.text(max_size=40))
def test_any_text_is_a_value_or_a_meter_error(text: str) -> None:
    with contextlib.suppress(MeterError):
        assert not math.isnan(parse_reading(text, "V", 0.0).value)


@pytest.mark.parametrize(
    ("text", "code"),
    [('+0,"No error"', 0), ('0,"No error"', 0), ('-113,"Undefined header"', -113), ("-222,Data out of range", -222)],
)
def test_an_error_queues_entry_is_its_number(text: str, code: int) -> None:
    entry = parse_error(text)
    assert entry is not None
    assert entry.code == code


@pytest.mark.parametrize("text", ["", "No error", "1.5E0", '"0,No error"'])
def test_what_is_no_entry_is_none(text: str) -> None:
    assert parse_error(text) is None


@pytest.mark.parametrize(
    ("text", "model"),
    [
        ("Agilent Technologies,34461A,MY1,A.02.14", "34461A"),
        ("KEITHLEY INSTRUMENTS INC.,MODEL 2000,0605,A20/A02", "MODEL 2000"),
        ("OWON,XDM1041,2129,V4.1.0,3", "XDM1041"),
        ("FLUKE, 45, 9080025, 1.6 D1.0", "45"),
        ("3M,METER,1,1", "METER"),
    ],
)
def test_an_identity_has_maker_and_model(text: str, model: str) -> None:
    identity = parse_identity(text)
    assert identity is not None
    assert identity.model == model


@pytest.mark.parametrize("text", ["", "34461A", "+1.0E+00,+2.0E+00,+3.0E+00", "HTTP/1.1 400", "a,,b", "\x80,x,y\x13"])
def test_what_is_no_identity_is_none(text: str) -> None:
    assert parse_identity(text) is None


def test_an_address_is_a_socket_or_a_port() -> None:
    assert parse_address("dmm-1.lab:5025") == TcpAddress("dmm-1.lab", 5025)
    assert parse_address("[::1]:5025") == TcpAddress("::1", 5025)
    assert str(parse_address("[::1]:5025")) == "[::1]:5025"
    assert parse_address("/dev/ttyUSB0") == SerialAddress("/dev/ttyUSB0")


@pytest.mark.parametrize("text", ["", "dmm", "dmm:0", "dmm:70000", "dmm:5025:1", "COM3", "tcp://dmm:5025", "::1:5025"])
def test_what_is_no_address_says_what_one_looks_like(text: str) -> None:
    with pytest.raises(ValueError, match=r"neither host:port \(192\.168\.0\.7:5025\) nor a serial port"):
        parse_address(text)
