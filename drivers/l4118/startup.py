"""What is done with a drive before it may be trusted: who is it, how does it speak, what lies where.

Nothing here moves an axis, and nothing is written through the process image. A drive found running (a former owner
died in a move) is brought to a halt and switched off first.
"""

import structlog

from drivers.bus import OdAddressing
from drivers.deadline import Deadline
from drivers.errors import DeviceRefused, LinkTimeout, MotionError, ReplyError
from drivers.l4118 import image
from drivers.l4118 import objects as od
from drivers.l4118.access import DriveAccess, key
from drivers.l4118.contract import AxisFindings, AxisStatus
from drivers.l4118.stopping import bring_to_rest
from drivers.l4118.units import SpeedUnit, decode_speed_unit

# Modbus exception 01
NO_SUCH_FUNCTION = 1
# Found so, or found running and brought to it
_SWITCHED_OFF = frozenset({od.PowerState.SWITCH_ON_DISABLED, od.PowerState.OPERATION_ENABLED})
# Enough for one question to a drive that has just left several without an answer
ALIVE_WITHIN_S = 0.5


class _OtherMaker(Exception):
    """A drive gives a vendor number that is not the configured one: what is to be raised, and the way of asking it."""

    def __init__(self, error: ReplyError, addressing: OdAddressing) -> None:
        super().__init__(str(error))
        self.error, self.addressing = error, addressing


async def prepare(drive: DriveAccess, deadline: Deadline) -> tuple[AxisFindings, SpeedUnit]:
    """Settle everything that is open about one drive; raise what does not fit.

    Raises LinkTimeout (silent), DeviceRefused (not such a drive), ReplyError (answers contradict each other).
    """
    try:
        drive.addressing = await _find_addressing(drive, deadline)
    except _OtherMaker as other:
        await _stop(drive, other)
        raise other.error from None
    drive.forget()
    if await bring_to_rest(drive, drive.command, od.Control.DISABLE_VOLTAGE) not in _SWITCHED_OFF:
        await drive.command(od.Control.DISABLE_VOLTAGE, deadline)
    motor_mode = await _sound_motor_mode(drive, deadline)
    drive.tx = await _ensure_mapping(drive, deadline)
    status = await _check_image(drive, deadline)
    switch_inputs = await _ensure_switch_inputs(drive, deadline)
    unit_kept = await _ensure_position_unit(drive, deadline)
    speed_raw = await drive.read(od.SPEED_UNIT, deadline)
    speed = decode_speed_unit(speed_raw, drive.config.increments_per_rev)
    if speed is None:
        text = "the drive counts its speed in a unit that this program does not know"
        advice = "Set the drive's speed unit (60A9h) to rpm (00B44700h) or increments/s (00B50300h)."
        technical = f"60A9h = {speed_raw:08X}h"
        raise MotionError(text, device=drive.config.name, advice=advice, technical=technical)
    if not unit_kept:
        await drive.write_checked(od.HOMED_MARKER, 0, deadline)
    marker = await drive.read(od.HOMED_MARKER, deadline)
    findings = AxisFindings(
        vendor_id=drive.config.vendor_id,
        addressing=drive.addressing,
        word_order=drive.word_order,
        position_unit=od.UNIT_INCREMENTS,
        speed_unit=speed_raw,
        tx_mapping=drive.tx.entries,
        motor_mode=motor_mode,
        switch_inputs=switch_inputs,
        homed=marker == drive.config.homed_marker,
        status=status,
        error_code=await drive.read(od.ERROR_CODE, deadline),
    )
    structlog.get_logger().info("axis.prepared", device=drive.config.name, findings=findings)
    return findings, speed


async def quieten(drive: DriveAccess, deadline: Deadline) -> None:
    """Bring a drive of which nothing is known to rest, and switch it off if it was on; nothing else is settled.

    A drive of another maker too.
    """
    try:
        drive.addressing = await _find_addressing(drive, deadline)
    except _OtherMaker as other:
        drive.addressing = other.addressing
    await bring_to_rest(drive, drive.command, od.Control.DISABLE_VOLTAGE)


async def _stop(drive: DriveAccess, other: _OtherMaker) -> None:
    """Bring a drive of another maker to rest; the error tells how that went.

    Raises MotionTimeout for one that runs and cannot be switched off.
    """
    drive.addressing = other.addressing
    try:
        found = await bring_to_rest(drive, drive.command, od.Control.DISABLE_VOLTAGE)
    except (DeviceRefused, LinkTimeout, ReplyError) as exc:
        other.error.message += "; whether it runs is not known"
        other.error.technical += f"; it was asked for its state: {exc.message}"
    else:
        if found is od.PowerState.OPERATION_ENABLED:
            other.error.message += "; it ran, and was stopped"


async def _find_addressing(drive: DriveAccess, deadline: Deadline) -> OdAddressing:
    """Read the vendor number in every way the manuals leave open; the way that gives it is the drive's."""
    config = drive.config
    if config.addressing is not None:
        candidates = [config.addressing]
    else:
        nodes = dict.fromkeys((1, 0, config.address))
        candidates = [OdAddressing(order, node) for order in ("big", "little") for node in nodes]
    found: list[str] = []
    others: list[OdAddressing] = []
    for candidate in candidates:
        try:
            vendor = await drive.read(od.VENDOR_ID, deadline, candidate)
        except (DeviceRefused, LinkTimeout, ReplyError) as exc:
            if isinstance(exc, DeviceRefused) and exc.code == NO_SUCH_FUNCTION:
                raise  # no way of asking helps against that
            if isinstance(exc, LinkTimeout) and not found and not await _answers(drive, deadline):
                raise
            found.append(f"{candidate.index_order}/node {candidate.node}: {exc.message} ({exc.technical})")
            continue
        if vendor == config.vendor_id:
            return candidate
        found.append(f"{candidate.index_order}/node {candidate.node}: vendor {vendor:08X}h")
        others.append(candidate)
    text = "what answers there is no drive of the maker that is configured (vendor_id)"
    technical = f"no way of asking gives vendor {config.vendor_id:08X}h: {'; '.join(found)}"
    advice = "Check the slave address and the drive's model."
    error = ReplyError(text, device=config.name, advice=advice, technical=technical)
    if others:
        raise _OtherMaker(error, others[0])
    raise error


async def _answers(drive: DriveAccess, deadline: Deadline) -> bool:
    """Tell a drive that is silent from one that does not answer FC 43."""
    try:
        await drive.alive(deadline.within(ALIVE_WITHIN_S))
    except LinkTimeout:
        return False
    return True


async def _read_mapping(drive: DriveAccess, deadline: Deadline) -> image.Layout:
    array = od.TX_MAPPING
    count = await drive.read(od.mapping_entry(array, 0), deadline)
    if count > 16:
        technical = f"{array:04X}h claims {count} entries of 16"
        raise ReplyError("its list of what it reports makes no sense", device=drive.config.name, technical=technical)
    numbers = range(1, count + 1)
    return image.parse([await drive.read(od.mapping_entry(array, number), deadline) for number in numbers])


async def _ensure_mapping(drive: DriveAccess, deadline: Deadline) -> image.Layout:
    """Take the drive's Tx mapping if it serves, else write ours and read it back."""
    array, wanted = od.TX_MAPPING, image.TX_WANTED
    layout = await _read_mapping(drive, deadline)
    if image.tx_serves(layout):
        return layout
    await drive.write(od.mapping_entry(array, 0), 0, deadline)
    for number, entry in enumerate(wanted, start=1):
        await drive.write(od.mapping_entry(array, number), entry, deadline)
    await drive.write(od.mapping_entry(array, 0), len(wanted), deadline)
    layout = await _read_mapping(drive, deadline)
    if layout.entries != tuple(wanted):
        kept = " ".join(f"{entry:08X}" for entry in layout.entries)
        text = "the drive does not keep the list of what it is to report"
        advice = "Check write_flag in object_access of this axis in the configuration."
        technical = f"mapping {array:04X}h did not take; it reads {kept}"
        raise ReplyError(text, device=drive.config.name, advice=advice, technical=technical)
    return layout


async def _check_image(drive: DriveAccess, deadline: Deadline) -> AxisStatus:
    """Compare the position in the image with the one by FC 43; it shows the word order, unless both read the same.

    Writes nothing. Returns the status that the same image tells.
    """
    registers = await drive.image(deadline)
    position = await drive.read(od.POSITION_ACTUAL, deadline)
    readings = drive.tx.both_orders(registers, key(od.POSITION_ACTUAL), signed=True)
    window = abs(drive.config.window_units * drive.config.increments_per_unit)
    if min(abs(reading - position) for reading in readings) > window:
        text = "the drive reports two different positions at once"
        advice = "Switch the drive off and on; if it stays, check its mapping (3602h) with the maker's tool."
        technical = f"position is {position} by FC 43 and {readings[0]} in the image"
        raise ReplyError(text, device=drive.config.name, advice=advice, technical=technical)
    shown = image.order_shown(*readings, position)
    if shown is not None:
        drive.note_word_order(shown)
    return await drive.status_in(registers, deadline)


async def _sound_motor_mode(drive: DriveAccess, deadline: Deadline) -> int | None:
    """Read 3202h; raise MotionError when it is no motor mode, or not the configured one.

    Programs that write through a process image whose layout they only remember leave a target or a speed there.
    """
    mode, wanted = await drive.read_if_there(od.MOTOR_MODE, deadline), drive.config.motor_mode
    if mode is None or (mode == wanted if wanted is not None else not mode >> 16):
        return mode
    expected = f"{wanted:08X}h is configured" if wanted is not None else "no motor mode has bits in its upper half"
    text = "the drive's motor mode is not what it should be; something was written over it"
    technical = f"3202h reads {mode & 0xFFFFFFFF:08X}h, and {expected}"
    advice = "Switch the drive's logic supply off and on; if it stays, set 3202h with the maker's tool and save it."
    error = MotionError(text, device=drive.config.name, advice=advice, technical=technical)
    error.object = od.MOTOR_MODE.place
    raise error


async def _ensure_switch_inputs(drive: DriveAccess, deadline: Deadline) -> int | None:
    """Read 3240h:01, and write it where the configuration says so."""
    found, wanted = await drive.read_if_there(od.SWITCH_INPUTS, deadline), drive.config.switch_inputs
    if wanted is not None and found != wanted:
        await drive.write_checked(od.SWITCH_INPUTS, wanted, deadline)
        return wanted
    if found is not None and drive.config.homing_switch & ~found:
        structlog.get_logger().warning("axis.switch_not_heeded", device=drive.config.name, object_3240h_01=found)
    return found


async def _ensure_position_unit(drive: DriveAccess, deadline: Deadline) -> bool:
    """Make the drive count in increments; tell whether it already did. Takes effect as it is switched off."""
    if await drive.read(od.POSITION_UNIT, deadline) == od.UNIT_INCREMENTS:
        return True
    await drive.write_checked(od.POSITION_UNIT, od.UNIT_INCREMENTS, deadline)
    return False
