"""Whether a reply answers the request it came after; the library does not look. Pure."""

from collections.abc import Sequence

from pymodbus.pdu import ModbusPDU

from drivers.bus import od
from drivers.bus.pdus import ExtendedException, GarbledReply, OdPdu
from drivers.errors import DeviceRefused, ReplyError

EXCEPTION_MEANING = {
    1: "illegal function",
    2: "illegal address",
    3: "illegal value",
    4: "device failure",
    5: "acknowledge",
    6: "busy",
    0x0A: "gateway path unavailable",
    0x0B: "no answer behind the gateway",
}
FOREIGN = "its answer is not to what it was asked"
SENSELESS = "its answer makes no sense"
OTHER_LENGTH = "its answer has another length than what was asked for"
ILLEGAL_FUNCTION = 1
FUNCTION_USE = {
    1: "read coils",
    3: "read registers",
    4: "read input registers",
    5: "write one coil",
    15: "write several coils",
    16: "write registers",
    od.FUNCTION_CODE: "be set up and commanded by its object dictionary (CiA 309)",
}
# The slave asks for patience: it works on this request (05), or on another and did not take this one (06)
BUSY = frozenset({5, 6})
NOT_DONE = frozenset({6})


def sound_reply(request: ModbusPDU, reply: ModbusPDU, device: str) -> ModbusPDU:
    """Give back `reply` when slave and function code are the asked ones; raise DeviceRefused or ReplyError."""
    if reply.dev_id != request.dev_id:
        raise ReplyError(f"slave {reply.dev_id} answered in its place", device=device)
    if reply.function_code & 0x7F != request.function_code:
        technical = f"reply to FC {request.function_code} has FC {reply.function_code}"
        raise ReplyError(FOREIGN, device=device, technical=technical)
    if isinstance(reply, GarbledReply):
        raise ReplyError(SENSELESS, device=device, technical=f"frame without sense: {reply.frame.hex(' ')}")
    if isinstance(reply, ExtendedException):
        raise _refusal(reply, device)
    return reply


def _refusal(reply: ExtendedException, device: str) -> DeviceRefused:
    if reply.exception_code == od.EXTENDED_EXCEPTION:
        code = od.abort_code(reply.detail)
        if code is None:
            technical = f"extended exception {reply.detail.hex(' ')}"
            text = "it refused, and its reason cannot be read"
            return DeviceRefused(text, device=device, code=reply.exception_code, technical=technical)
        meaning = od.ABORT_MEANING.get(code, "for a reason not known here")
        return DeviceRefused(f"it refused: {meaning}", device=device, code=code, technical=f"abort {code:08X}h")
    meaning = EXCEPTION_MEANING.get(reply.exception_code, "for a reason not known here")
    function = reply.function_code & 0x7F
    technical = f"exception {reply.exception_code:02X}h to FC {function}"
    advice = _without(function) if reply.exception_code == ILLEGAL_FUNCTION else None
    text = f"it refused: {meaning}"
    return DeviceRefused(text, device=device, code=reply.exception_code, advice=advice, technical=technical)


def _without(function: int) -> str:
    """Say what it means that a device has no such function code."""
    what = FUNCTION_USE.get(function, "do what was asked for")
    return f"This device does not know how to {what}: update its firmware, or use one that does."


def registers(reply: ModbusPDU, count: int, device: str) -> tuple[int, ...]:
    """Give the registers of a read reply; raise ReplyError when there are not exactly `count`."""
    if len(reply.registers) != count:
        technical = f"{count} registers asked, {len(reply.registers)} came"
        raise ReplyError(OTHER_LENGTH, device=device, technical=technical)
    return tuple(reply.registers)


def coils(reply: ModbusPDU, count: int, device: str) -> tuple[bool, ...]:
    """Give the coils of a read reply, without the padding; raise ReplyError when the length is wrong."""
    if len(reply.bits) != (count + 7) // 8 * 8:
        raise ReplyError(OTHER_LENGTH, device=device, technical=f"{count} coils asked, {len(reply.bits)} bits came")
    return tuple(bool(bit) for bit in reply.bits[:count])


def coils_echoed(reply: ModbusPDU, address: int, values: Sequence[object], device: str) -> None:
    """Check the echo of a write of coils; some boards confirm all eight of theirs, whatever was written."""
    first, behind = reply.address, reply.address + reply.count
    if reply.count % 8 or first > address or behind < address + len(values):
        echoed(reply, address, values, device)


def coil_echoed(reply: ModbusPDU, address: int, value: bool, device: str) -> None:  # noqa: FBT001 - a level
    """Check the echo of a write of one coil; raise ReplyError when it is another write's."""
    if (reply.address, list(reply.bits[:1])) != (address, [value]):
        technical = f"wrote coil {address} {value}, reply confirms coil {reply.address} {list(reply.bits[:1])}"
        raise ReplyError(FOREIGN, device=device, technical=technical)


def echoed(reply: ModbusPDU, address: int, values: Sequence[object], device: str) -> None:
    """Check the echo of a write of several registers; raise ReplyError when it is another write's."""
    if (reply.address, reply.count) != (address, len(values)):
        technical = f"wrote {len(values)} at {address}, reply confirms {reply.count} at {reply.address}"
        raise ReplyError(FOREIGN, device=device, technical=technical)


def od_telegram(reply: ModbusPDU, device: str) -> od.OdTelegram:
    """Give the telegram in an FC 43/13 reply; raise ReplyError when there is none."""
    body = reply.body if isinstance(reply, OdPdu) else b""
    try:
        return od.OdTelegram.decode(body)
    except ValueError as exc:
        raise ReplyError(SENSELESS, device=device, technical=str(exc)) from exc
