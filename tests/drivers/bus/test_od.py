"""FC 43/13 telegrams: bytes <-> dataclasses."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.bus import OdAddressing, OdEntry, od
from tests.drivers.peers.line import framed


def test_a_read_request_has_the_bytes_of_cia_309() -> None:
    """It should be ID 2B 0D CTRL 00 NODE IDX IDX SUB START START NUM NUM, index high byte first."""
    body = od.read_request(OdEntry(0x6064), OdAddressing(node=1)).encode()
    assert body == bytes.fromhex("0d 00 00 01 60 64 00 00 00 00 04")


def test_the_write_example_of_the_manual_comes_out_byte_by_byte() -> None:
    """With a little-endian index it should give the frame whose CRC the manual's picture shows."""
    telegram = od.write_request(OdEntry(0x0123), 0x12345678, OdAddressing("little", 1))
    frame = framed(bytes([5, 0x2B]) + telegram.encode())
    assert frame == bytes.fromhex("05 2B 0D 01 00 01 23 01 00 00 00 00 04 78 56 34 12 67 35")


@given(
    st.integers(0, 0xFFFF),
    st.integers(0, 255),
    st.sampled_from([1, 2, 4]),
    st.booleans(),
    st.sampled_from(["big", "little"]),
    st.data(),
)
def test_a_value_written_and_read_is_the_same(
    index: int, sub: int, size: int, signed: bool, order: str, data: st.DataObject
) -> None:
    """It should carry any value that fits, in any addressing."""
    low, high = (-(1 << 8 * size - 1), (1 << 8 * size - 1) - 1) if signed else (0, (1 << 8 * size) - 1)
    value = data.draw(st.integers(low, high))
    entry, addressing = OdEntry(index, sub, size, signed), OdAddressing(order)  # type: ignore[arg-type]
    written = od.OdTelegram.decode(od.write_request(entry, value, addressing).encode())
    request = od.read_request(entry, addressing)
    reply = od.OdTelegram(0, written.node, written.index_bytes, sub, 0, size, written.data)
    assert od.read_value(request, reply, signed=signed) == value


@given(st.binary(max_size=40))
def test_any_bytes_are_a_telegram_or_a_value_error(data: bytes) -> None:
    """It should never raise anything but ValueError, and encode what it accepted (the reserved byte aside)."""
    try:
        telegram = od.OdTelegram.decode(data)
    except ValueError:
        return
    assert telegram.encode() == data[:2] + b"\0" + data[3:]


@given(st.binary(max_size=16))
def test_any_extended_exception_is_an_abort_or_none(body: bytes) -> None:
    """It should never raise."""
    code = od.abort_code(body)
    assert code is None or 0 <= code <= 0xFFFFFFFF


@pytest.mark.parametrize("raw", ["06 02 00 00", "00 00 02 06"])
def test_the_byte_order_of_an_abort_code_is_found_by_its_class(raw: str) -> None:
    """It should read 'no such object' in both orders."""
    assert od.abort_code(bytes.fromhex("00 06 0d ce") + bytes.fromhex(raw)) == 0x06020000


REQUEST = od.read_request(OdEntry(0x6064), OdAddressing())


@pytest.mark.parametrize(
    "reply",
    [
        od.OdTelegram(0, 1, b"\x60\x41", 0, 0, 4, bytes(4)),
        od.OdTelegram(0, 1, b"\x60\x64", 1, 0, 4, bytes(4)),
        od.OdTelegram(0, 2, b"\x60\x64", 0, 0, 4, bytes(4)),
        od.OdTelegram(1, 1, b"\x60\x64", 0, 0, 4, bytes(4)),
        od.OdTelegram(0, 1, b"\x60\x64", 0, 4, 4, bytes(4)),
        od.OdTelegram(0, 1, b"\x60\x64", 0, 0, 2, bytes(2)),
        od.OdTelegram(0, 1, b"\x60\x64", 0, 0, 4, bytes(2)),
    ],
    ids=["index", "subindex", "node", "control", "start", "count", "data"],
)
def test_a_reply_about_something_else_is_refused(reply: od.OdTelegram) -> None:
    """It should not take the value of another object, or of another length."""
    with pytest.raises(ValueError, match="asked"):
        od.read_value(REQUEST, reply, signed=False)


def test_both_write_replies_are_accepted_and_no_other() -> None:
    """It should take NUM = 0, NUM echoed, NUM echoed with the data; not another NUM or other data."""
    request = od.write_request(OdEntry(0x6081), 5, OdAddressing())
    head = (request.control, request.node, request.index_bytes, request.subindex, request.start)
    for count, data in ((0, b""), (4, b""), (4, request.data)):
        od.check_write_reply(request, od.OdTelegram(*head, count, data))
    for count, data in ((2, b""), (4, b"\1\2\3\4")):
        with pytest.raises(ValueError, match="repl"):
            od.check_write_reply(request, od.OdTelegram(*head, count, data))


def test_an_object_is_named_by_index_and_subindex() -> None:
    """It should be the place in the drive's manual, short enough for a field."""
    assert [OdEntry(0x6041).place, OdEntry(0x1003, 1).place, OdEntry(0x2400, 0x20).place] == [
        "6041h:00",
        "1003h:01",
        "2400h:20",
    ]
