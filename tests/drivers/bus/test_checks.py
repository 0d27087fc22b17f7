"""Replies against requests, for what no serial line can be made to send."""

import pytest
from pymodbus.pdu.register_message import ReadHoldingRegistersRequest

from drivers.bus import checks
from drivers.bus.pdus import OdPdu, ReplyDecoder, frame_sizes
from drivers.errors import ReplyError

REQUEST = ReadHoldingRegistersRequest(dev_id=1, address=0, count=1)


@pytest.mark.parametrize("pdu", ["", "03", "03 04 00", "07 00", "ab"])
def test_a_pdu_without_sense_is_a_reply_error(pdu: str) -> None:
    """It should decode to something that is refused, and never raise a foreign error."""
    reply = ReplyDecoder().decode(bytes.fromhex(pdu))
    reply.dev_id = 1
    with pytest.raises(ReplyError):
        checks.registers(checks.sound_reply(REQUEST, reply, "X"), 1, "X")


def test_a_reply_of_another_slave_is_refused_on_tcp_too() -> None:
    """It should compare the slave where the framer does not."""
    reply = ReplyDecoder().decode(bytes.fromhex("03 02 00 01"))
    reply.dev_id = 2
    with pytest.raises(ReplyError, match="slave 2"):
        checks.sound_reply(REQUEST, reply, "X")


def test_an_object_reply_of_another_kind_is_refused() -> None:
    """It should not take device identification (MEI 14) for an object."""
    with pytest.raises(ReplyError, match="no object dictionary telegram"):
        checks.od_telegram(OdPdu(bytes.fromhex("0e 01")), "X")


@pytest.mark.parametrize("data", ["01 03", "01 07 00 00", "01 2b 0d 00 00", "01 ab ff 00"])
def test_a_length_not_known_yet_is_waited_for(data: str) -> None:
    """It should give no length for a frame too short to tell, nor for an unknown function."""
    assert frame_sizes(bytes.fromhex(data), od_write=False) == ()
