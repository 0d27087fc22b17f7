"""What is done with a drive before it may be trusted: who is it, how does it speak, what lies where.

Nothing here moves an axis. A drive found running (a former owner died in a move) is brought to a halt and
switched off first.
"""

import asyncio
from collections.abc import Sequence

import structlog

from drivers.bus import OdAddressing
from drivers.deadline import Deadline
from drivers.errors import DeviceRefused, LinkTimeout, MotionError, MotionTimeout, ReplyError
from drivers.l4118 import image
from drivers.l4118 import objects as od
from drivers.l4118.access import DriveAccess
from drivers.l4118.contract import AxisFindings, AxisStatus
from drivers.l4118.units import SpeedUnit, decode_speed_unit

# Two different words, and a number that means no move worth the name if ever it were taken for a target
_ORDER_PATTERN = 0x0001_0002
_ORDER_SWAPPED = 0x0002_0001
# 607Dh 0/0: no software limits
_HALT_S = 3.0


async def prepare(drive: DriveAccess, deadline: Deadline) -> tuple[AxisFindings, SpeedUnit]:
    """Settle everything that is open about one drive; raise what does not fit.

    Raises LinkTimeout (silent), DeviceRefused (not such a drive), ReplyError (answers contradict each other).
    """
    await drive.alive(deadline)
    drive.addressing = await _find_addressing(drive, deadline)
    await _bring_to_rest(drive, deadline)
    drive.tx = await _ensure_mapping(drive, od.TX_MAPPING, image.TX_WANTED, deadline)
    drive.rx = await _ensure_mapping(drive, od.RX_MAPPING, image.RX_WANTED, deadline)
    status = await _settle_word_order(drive, deadline)
    unit_kept = await _ensure_position_unit(drive, deadline)
    speed_raw = await drive.read(od.SPEED_UNIT, deadline)
    speed = decode_speed_unit(speed_raw, drive.config.increments_per_rev)
    if speed is None:
        text = f"speed unit 60A9h = {speed_raw:08X}h is not one this driver can use"
        advice = "Set 60A9h to 00B44700h (rpm) or 00B50300h (increments/s)."
        raise MotionError(text, device=drive.config.name, advice=advice)
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
        rx_mapping=drive.rx.entries,
        homed=marker == drive.config.homed_marker,
        status=status,
        error_code=await drive.read(od.ERROR_CODE, deadline),
    )
    structlog.get_logger().info("axis.prepared", device=drive.config.name, findings=findings)
    return findings, speed


async def _find_addressing(drive: DriveAccess, deadline: Deadline) -> OdAddressing:
    """Read the vendor number in every way the manuals leave open; the way that gives it is the drive's."""
    config = drive.config
    if config.addressing is not None:
        candidates = [config.addressing]
    else:
        nodes = dict.fromkeys((1, 0, config.address))
        candidates = [OdAddressing(order, node) for order in ("big", "little") for node in nodes]
    found: list[str] = []
    for candidate in candidates:
        try:
            vendor = await drive.read(od.VENDOR_ID, deadline, candidate)
        except (DeviceRefused, LinkTimeout, ReplyError) as exc:
            found.append(f"{candidate.index_order}/node {candidate.node}: {exc.message}")
            continue
        if vendor == config.vendor_id:
            return candidate
        found.append(f"{candidate.index_order}/node {candidate.node}: vendor {vendor:08X}h")
    text = f"no way of asking gives vendor {config.vendor_id:08X}h ({'; '.join(found)})"
    raise ReplyError(text, device=config.name, advice="Check the slave address and the drive's model.")


async def _bring_to_rest(drive: DriveAccess, deadline: Deadline) -> None:
    """Halt and switch off a drive that is running; by FC 43, as the image's layout is not known yet."""
    statusword = await drive.read(od.STATUSWORD, deadline)
    if od.decode_state(statusword) is not od.PowerState.OPERATION_ENABLED:
        return
    structlog.get_logger().warning("axis.found_running", device=drive.config.name)
    await drive.write(od.CONTROLWORD, od.Control.HALT, deadline)
    limit = deadline.within(_HALT_S)
    while not statusword & od.SW_TARGET_REACHED:
        if limit.expired:
            break  # switching off stops it too, only harder
        await asyncio.sleep(drive.config.poll_s)
        statusword = await drive.read(od.STATUSWORD, deadline)
    await drive.write(od.CONTROLWORD, od.Control.SHUTDOWN, deadline)
    while od.decode_state(statusword) is od.PowerState.OPERATION_ENABLED:
        if deadline.expired:
            raise MotionTimeout("found running and cannot be switched off", device=drive.config.name)
        await asyncio.sleep(drive.config.poll_s)
        statusword = await drive.read(od.STATUSWORD, deadline)


async def _read_mapping(drive: DriveAccess, array: int, deadline: Deadline) -> image.Layout:
    count = await drive.read(od.mapping_entry(array, 0), deadline)
    if count > 16:
        raise ReplyError(f"{array:04X}h claims {count} entries of 16", device=drive.config.name)
    numbers = range(1, count + 1)
    return image.parse([await drive.read(od.mapping_entry(array, number), deadline) for number in numbers])


async def _ensure_mapping(drive: DriveAccess, array: int, wanted: Sequence[int], deadline: Deadline) -> image.Layout:
    """Take the drive's mapping if it serves, else write ours and read it back."""
    serves = image.tx_serves if array == od.TX_MAPPING else image.rx_serves
    layout = await _read_mapping(drive, array, deadline)
    if serves(layout):
        return layout
    await drive.write(od.mapping_entry(array, 0), 0, deadline)
    for number, entry in enumerate(wanted, start=1):
        await drive.write(od.mapping_entry(array, number), entry, deadline)
    await drive.write(od.mapping_entry(array, 0), len(wanted), deadline)
    layout = await _read_mapping(drive, array, deadline)
    if layout.entries != tuple(wanted):
        kept = " ".join(f"{entry:08X}" for entry in layout.entries)
        text = f"mapping {array:04X}h did not take; it reads {kept}"
        raise ReplyError(text, device=drive.config.name, advice="Check the FC 43 write flag of this drive.")
    return layout


async def _settle_word_order(drive: DriveAccess, deadline: Deadline) -> AxisStatus:
    """Write a target with two different words into the image, power off, and read it back by FC 43.

    Without a set-point edge in operation enabled this starts nothing. Then the position is compared both ways. Returns
    the status that came with it.
    """
    drive.word_order = "big"
    drive.target_increments, drive.velocity_counts = _ORDER_PATTERN, 0
    await drive.command(od.Control.DISABLE_VOLTAGE, deadline)
    seen = await drive.read(od.TARGET_POSITION, deadline)
    orders: dict[int, image.WordOrder] = {_ORDER_PATTERN: "big", _ORDER_SWAPPED: "little"}
    if seen not in orders:
        text = f"607Ah written by the image as {_ORDER_PATTERN:08X}h reads {seen & 0xFFFFFFFF:08X}h by FC 43"
        raise ReplyError(text, device=drive.config.name, advice="Check the mapping 3502h of this drive.")
    drive.word_order = orders[seen]
    wanted = drive.config.word_order
    if wanted not in ("auto", drive.word_order):
        text = f"word order is {drive.word_order}, the configuration says {wanted}"
        raise ReplyError(text, device=drive.config.name, advice="Set word_order to auto.")
    position = await drive.read(od.POSITION_ACTUAL, deadline)
    drive.target_increments = position
    status = await drive.command(od.Control.DISABLE_VOLTAGE, deadline)
    by_image = drive.config.to_increments(status.position_units)
    if abs(by_image - position) > abs(drive.config.window_units * drive.config.increments_per_unit):
        text = f"position is {position} by FC 43 and {by_image} in the image"
        raise ReplyError(text, device=drive.config.name, advice="Check the mapping 3602h of this drive.")
    return status


async def _ensure_position_unit(drive: DriveAccess, deadline: Deadline) -> bool:
    """Make the drive count in increments; tell whether it already did. Takes effect as it is switched off."""
    if await drive.read(od.POSITION_UNIT, deadline) == od.UNIT_INCREMENTS:
        return True
    await drive.write_checked(od.POSITION_UNIT, od.UNIT_INCREMENTS, deadline)
    return False
