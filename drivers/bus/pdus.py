"""The pymodbus side of the line: PDUs for FC 43/13, a decoder and a framer that fit one open request.

The library's own decoder takes AB FF for a five byte exception (so an abort becomes a time-out), and its RTU
framer throws a good frame away when a few bytes of noise stand before it. Both are replaced here.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from pymodbus.framer import FramerRTU
from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU
from pymodbus.pdu.bit_message import (
    ReadCoilsResponse,
    WriteMultipleCoilsResponse,
    WriteSingleCoilResponse,
)
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersResponse,
    ReadInputRegistersResponse,
    WriteMultipleRegistersResponse,
)

from drivers.bus import od

# Address, function code, CRC
_SHORTEST_FRAME = 4
_EXCEPTION_FRAME = 5


class OdPdu(ModbusPDU):
    """FC 43 / MEI 13, request and reply alike: the telegram is kept as bytes."""

    function_code = od.FUNCTION_CODE
    sub_function_code = od.MEI_TYPE

    def __init__(self, body: bytes = b"", dev_id: int = 0) -> None:
        super().__init__(dev_id=dev_id)
        self.body = body

    def encode(self) -> bytes:
        """Give the bytes after the function code."""
        return self.body

    def decode(self, data: bytes) -> None:
        """Keep the bytes after the function code."""
        self.body = data


class ExtendedException(ExceptionResponse):
    """An exception reply with whatever stands behind its code (AB FF and its CANopen abort)."""

    def __init__(self, function_code: int) -> None:
        super().__init__(function_code)
        self.detail = b""

    def decode(self, data: bytes) -> None:
        """Split code and detail."""
        super().decode(data)
        self.detail = data[1:]


class GarbledReply(ModbusPDU):
    """A frame with a right CRC whose content makes no sense; ends the wait at once instead of by time-out."""

    def __init__(self, frame: bytes) -> None:
        super().__init__()
        self.function_code = frame[0] if frame else 0
        self.frame = frame


REPLIES: dict[int, type[ModbusPDU]] = {
    0x01: ReadCoilsResponse,
    0x03: ReadHoldingRegistersResponse,
    0x04: ReadInputRegistersResponse,
    0x05: WriteSingleCoilResponse,
    0x0F: WriteMultipleCoilsResponse,
    0x10: WriteMultipleRegistersResponse,
    od.FUNCTION_CODE: OdPdu,
}
# FC 06 is never sent, but a stray reply of it must be known to be named as wrong.
_FIXED_FRAME = {0x05: 8, 0x06: 8, 0x0F: 8, 0x10: 8}
_COUNTED = (0x01, 0x02, 0x03, 0x04, 0x17)


def frame_sizes(data: bytes, *, od_write: bool) -> Sequence[int]:
    """List the lengths the RTU reply beginning at `data[0]` may have, shortest first; empty when unknown yet."""
    if len(data) < _SHORTEST_FRAME:
        return ()
    code = data[1]
    if code & 0x80:
        if data[2] == od.EXTENDED_EXCEPTION and code & 0x7F == od.FUNCTION_CODE:
            return (7 + int.from_bytes(data[3:5], "big"),) if len(data) > 4 else ()
        return (_EXCEPTION_FRAME,)
    if code in _FIXED_FRAME:
        return (_FIXED_FRAME[code],)
    if code in _COUNTED:
        return (5 + data[2],)
    if code == od.FUNCTION_CODE:
        bare = 1 + od.HEADER_BYTES + 2
        if len(data) < bare - 2:
            return ()
        full = bare + int.from_bytes(data[11:13], "big")
        # A write may be answered with NUM echoed and no data: only the CRC tells.
        return (bare, full) if od_write else (full,)
    return ()


@dataclass(slots=True)
class Expectation:
    """What the open request waits for."""

    device_id: int = 0
    od_write: bool = False


class ReplyDecoder(DecodePDU):
    """Turn the PDU of a reply into an object; never raises, never gives None."""

    def __init__(self) -> None:
        super().__init__(is_server=False)

    def decode(self, frame: bytes) -> ModbusPDU:
        """Decode one reply PDU (function code first)."""
        try:
            if frame[0] & 0x80:
                pdu: ModbusPDU = ExtendedException(frame[0] & 0x7F)
            else:
                pdu = REPLIES[frame[0]]()
            pdu.decode(frame[1:])
        except Exception:  # noqa: BLE001 - the library's decoders raise whatever the bytes make them raise
            return GarbledReply(frame)
        return pdu


class HuntingRtuFramer(FramerRTU):
    """Find the reply of the asked slave anywhere in what came: the first stretch with a right CRC is it.

    Noise before and after the frame is ignored, as are frames of other slaves. Bytes without a valid frame
    stay in the library's buffer until the request is over, so that "garbled" and "silent" can be told apart.
    """

    def __init__(self, decoder: ReplyDecoder, expectation: Expectation) -> None:
        super().__init__(decoder)
        self.expectation = expectation

    def decode(self, data: bytes) -> tuple[int, int, int, bytes]:
        """Give (used bytes, slave, 0, PDU), or zeros while no whole frame is there."""
        for start in range(len(data) - _SHORTEST_FRAME + 1):
            if data[start] != self.expectation.device_id:
                continue
            for size in frame_sizes(data[start:], od_write=self.expectation.od_write):
                frame = data[start : start + size]
                if len(frame) == size and self.check_CRC(frame[:-2], int.from_bytes(frame[-2:], "big")):
                    return len(data), frame[0], 0, frame[1:-2]
        return 0, 0, 0, b""
