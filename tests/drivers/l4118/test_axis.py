"""One axis over real bytes: start, states, moves, faults."""

import asyncio
import dataclasses
from collections.abc import Callable
from typing import Any

import pytest

from drivers.bus import OdAddressing
from drivers.deadline import Deadline
from drivers.errors import (
    DeviceError,
    DeviceRefused,
    DriveFault,
    EmergencyStop,
    EnvelopeViolation,
    LimitHit,
    LinkTimeout,
    MotionError,
    MotionTimeout,
    ReplyError,
    Stalled,
)
from drivers.l4118 import HEALTH_REQUESTS, Axis
from drivers.l4118.image import TX_WANTED
from tests.drivers.conftest import MakeLine, OpenBus
from tests.drivers.l4118.conftest import CONFIG, Homed, MakeAxis
from tests.drivers.peers.drive import DEFAULT_TX, DriveModel, Variant

# ---------------------------------------------------------------- start
VARIANTS = [
    Variant(),
    Variant(index_order="little"),
    Variant(node=3),
    Variant(node=0, index_order="little"),
    Variant(word_order="little"),
    Variant(write_reply="echo"),
    Variant(abort_order="little", index_order="little"),
    Variant(position_unit=0x00B50000, speed_unit=0x00B50300),
]


@pytest.mark.parametrize("variant", VARIANTS, ids=str)
async def test_every_open_point_of_the_manuals_is_settled_without_motion(
    make_axis: MakeAxis, soon: Deadline, variant: Variant
) -> None:
    """It should find index order, NODE and word order by itself, and then move to the right place."""
    drive = DriveModel(3, variant)
    drive.position = 0x12345
    axis = await make_axis(drive)
    found = await axis.start(soon)
    assert drive.log == []
    assert found.addressing.index_order == variant.index_order
    assert variant.node in (None, found.addressing.node)
    assert found.word_order == variant.word_order
    assert drive.od[0x60A8, 0][1] == 0x00B50000
    await axis.home(soon)
    await axis.move_to(20000.0, soon)
    assert drive.position == 20000 * 1638.4
    assert await axis.position(soon) == 20000.0


async def test_a_mapping_that_lacks_something_is_replaced_and_one_that_serves_is_kept(
    make_axis: MakeAxis, soon: Deadline
) -> None:
    """It should write its own image where the drive's has foreign objects, and leave a fitting one alone."""
    drive = DriveModel(3)
    axis = await make_axis(drive)
    found = await axis.start(soon)
    assert found.tx_mapping == TX_WANTED
    longer = (*DEFAULT_TX[:5], 0x00060010, 0x60FD0020)
    drive.od[0x3602, 0][1] = len(longer)
    for number, entry in enumerate(longer, 1):
        drive.od[0x3602, number][1] = entry
    assert (await axis.start(soon)).tx_mapping == longer
    drive.inputs = 0x3
    assert (await axis.status(soon)).positive_limit


async def test_raw_inputs_are_numbered_as_on_the_drives_plug(make_axis: MakeAxis, soon: Deadline) -> None:
    """It should tell each input from the others, and from the switches' own bits."""
    drive = DriveModel(3)
    axis = await make_axis(drive)
    await axis.start(soon)
    for number in (1, 4, 6):
        drive.inputs = 0xF | 1 << (15 + number)
        assert [n for n in range(1, 7) if await axis.raw_input(n, soon)] == [number]


async def test_a_mapping_that_does_not_take_is_an_error(make_axis: MakeAxis, soon: Deadline) -> None:
    """It should read back what it wrote and not work on with another image."""
    drive = DriveModel(3)
    keep = drive.put
    drive.put = lambda index, sub, value: None if index == 0x3602 else keep(index, sub, value)  # type: ignore[method-assign]
    with pytest.raises(ReplyError, match="3602h did not take"):
        await (await make_axis(drive)).start(soon)


@pytest.mark.parametrize(
    ("spoil", "error", "text"),
    [
        (lambda d: setattr(d, "silent", True), LinkTimeout, "no answer"),
        (lambda d: d.od.update({(0x1018, 1): [4, 0x99]}), ReplyError, "vendor 00000099h"),
        (lambda d: d.od.update({(0x60A9, 0): [4, 0x00010300]}), MotionError, "60A9h = 00010300h"),
        (lambda d: d.od.update({(0x3602, 0): [1, 17]}), ReplyError, "17 entries"),
    ],
)
async def test_a_drive_that_does_not_fit_is_refused(
    make_axis: MakeAxis, soon: Deadline, spoil: Callable[[Any], object], error: type[DeviceError], text: str
) -> None:
    """It should say what is wrong instead of working on."""
    drive = DriveModel(3)
    spoil(drive)
    axis = await make_axis(drive, timeout_s=0.2)
    with pytest.raises(error, match=text):
        await axis.start(soon)


async def test_settings_that_contradict_the_drive_are_refused(make_axis: MakeAxis, soon: Deadline) -> None:
    """It should not overrule what the drive shows."""
    drive = DriveModel(3)
    drive.position = 0x12345
    wrong_words = await make_axis(drive, dataclasses.replace(CONFIG, word_order="little"))
    with pytest.raises(ReplyError, match="word order is big"):
        await wrong_words.start(soon)
    wrong_index = dataclasses.replace(CONFIG, addressing=OdAddressing("little"))
    with pytest.raises(ReplyError, match="object does not exist"):
        await (await make_axis(drive, wrong_index)).start(soon)


async def test_a_drive_found_running_is_brought_to_rest(make_axis: MakeAxis, homed: Homed, soon: Deadline) -> None:
    """It should halt and switch off a drive whose former owner died in a move."""
    axis, drive = homed
    drive.step = 1000
    await axis.begin_move(20000.0, soon)
    assert drive.state == 0x27
    again = await make_axis(drive)
    await again.start(soon)
    assert drive.state == 0x40
    stands = drive.position
    await again.position(soon)
    assert drive.position == stands


async def test_software_limits_and_ramps_are_in_the_drive(homed: Homed) -> None:
    """It should give the drive its range once it is homed."""
    _, drive = homed
    assert drive.od[0x607D, 1][1] == 0
    assert drive.od[0x607D, 2][1] == 30000 * 1638.4
    # 100000 um/s2 are 50 rev/s2 of a 2 mm screw: 3000 rpm/s
    assert drive.od[0x6083, 0][1] == 3000


async def test_a_start_on_a_drive_that_is_set_up_writes_nothing(
    make_axis: MakeAxis, homed: Homed, soon: Deadline
) -> None:
    """It should ask once for each of its settings: a start of four drives is to be over within a second."""
    _, drive = homed
    await (await make_axis(drive)).start(soon)
    written: list[int] = []
    asked: list[int] = []
    put, answer = drive.put, drive.answer
    drive.put = lambda index, sub, value: [written.append(index), put(index, sub, value)][1]  # type: ignore[method-assign]
    drive.answer = lambda request: [asked.append(request[1]), answer(request)][1]  # type: ignore[method-assign]
    found = await (await make_axis(drive)).start(soon)
    assert found.homed
    assert written == []
    assert len(asked) <= 21


async def test_a_setting_that_another_program_changed_is_written_at_the_next_start(
    make_axis: MakeAxis, homed: Homed, soon: Deadline
) -> None:
    """It should leave the ramps and limits of the configuration in the drive, whatever it found."""
    _, drive = homed
    before = {place: drive.od[place][1] for place in ((0x6083, 0), (0x6085, 0), (0x607D, 1), (0x607D, 2))}
    for place in before:
        drive.od[place][1] += 17
    await (await make_axis(drive)).start(soon)
    assert {place: drive.od[place][1] for place in before} == before


# ---------------------------------------------------------------- moves
async def test_a_move_follows_the_handshake(homed: Homed, soon: Deadline) -> None:
    """It should step through the states, set one set-point and wait for its acknowledge."""
    axis, drive = homed
    await axis.move_to(500.0, soon)
    assert drive.log == ["27->40", "40->21", "21->23", "23->27", f"move {500 * 1638.4:.0f}"]
    drive.log.clear()
    await axis.move_to(100.0, soon)
    assert drive.log == [f"move {100 * 1638.4:.0f}"]


async def test_a_short_move_is_not_believed_before_its_acknowledge(homed: Homed, soon: Deadline) -> None:
    """It should wait for bit 12: the target-reached bit is still the former move's."""
    axis, drive = homed
    await axis.move_to(500.0, soon)
    drive.no_acknowledge = True
    with pytest.raises(MotionTimeout, match="not acknowledged"):
        await axis.move_to(600.0, soon)


async def test_lost_replies_do_not_double_a_move(make_line: MakeLine, open_bus: OpenBus, soon: Deadline) -> None:
    """It should come to the same place though every third reply is lost."""
    drive = DriveModel(3)
    count = 0

    def lossy(request: bytes) -> list:
        nonlocal count
        count += 1
        reply = drive.answer(request)
        return [] if count % 3 == 0 else reply

    axis = Axis(await open_bus(make_line(lossy), timeout_s=0.1, late_reply_s=0.1, attempts=8), CONFIG)
    await axis.home(soon)
    await axis.move_to(700.0, soon)
    assert drive.position == 700 * 1638.4
    assert [entry for entry in drive.log if entry.startswith("move")] == [f"move {700 * 1638.4:.0f}"]


@pytest.mark.parametrize("target", [-0.1, 30000.1])
async def test_a_target_outside_is_refused_before_anything_moves(homed: Homed, soon: Deadline, target: float) -> None:
    """It should name the range."""
    axis, drive = homed
    with pytest.raises(EnvelopeViolation, match=r"0\.000\.\.30000\.000"):
        await axis.move_to(target, soon)
    assert drive.log == []


async def test_a_cancelled_move_stops_the_motor_before_it_is_cancelled(homed: Homed, soon: Deadline) -> None:
    """It should halt and switch off, so that the old target is not taken up again."""
    axis, drive = homed
    drive.step = 1000
    task = asyncio.create_task(axis.move_to(20000.0, soon))
    while not drive.position:
        await asyncio.sleep(0)
        await axis.status(soon)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert drive.state == 0x21
    stands = drive.position
    drive.step = 2_000_000
    axis.release()
    await axis.move_to(100.0, soon)
    assert 0 < stands < 20000 * 1638.4
    assert drive.position == 100 * 1638.4


async def test_a_deadline_ends_a_move_with_a_halt(homed: Homed) -> None:
    """It should raise MotionTimeout with the motor standing."""
    axis, drive = homed
    drive.step = 10_000
    with pytest.raises(MotionTimeout, match="deadline"):
        await axis.move_to(30000.0, Deadline.after(1.0))
    assert drive.state == 0x21


async def test_a_blocked_axis_is_a_stall(homed: Homed, soon: Deadline) -> None:
    """It should notice that the position stands still."""
    axis, drive = homed
    drive.stuck = True
    with pytest.raises(Stalled, match=r"stands at 0\.000, 500\.000 short"):
        await axis.move_to(500.0, soon)
    assert drive.state == 0x21


@pytest.mark.parametrize(
    ("inputs", "start", "target", "text"), [(1, 500.0, 100.0, "negative"), (2, 500.0, 900.0, "positive")]
)
async def test_a_limit_switch_on_the_way_is_a_limit_hit(
    homed: Homed, soon: Deadline, inputs: int, start: float, target: float, text: str
) -> None:
    """It should stop on the switch ahead, and may leave the one behind."""
    axis, drive = homed
    await axis.move_to(start, soon)
    drive.inputs, drive.step = inputs, 1000
    with pytest.raises(LimitHit, match=text):
        await axis.move_to(target, soon)
    axis.release()
    drive.step = 2_000_000
    await axis.move_to(start + (start - target), soon)


@pytest.mark.parametrize(
    ("code", "entry", "error", "text"),
    [
        (0x8611, 0x0D008611, Stalled, "following error"),
        (0x7121, 0x0F007121, Stalled, "motor blocked"),
        (0xFF00, 0x0A00FF00, LimitHit, "negative limit"),
        (0x3220, 0x03043220, EmergencyStop, "under-voltage"),
        (0x3210, 0x01003210, DriveFault, "over-voltage"),
        (0x1234, 0x63001234, DriveFault, "error number 99"),
    ],
)
async def test_a_fault_in_a_move_is_named(
    homed: Homed, soon: Deadline, code: int, entry: int, error: type[DeviceError], text: str
) -> None:
    """It should read code and meaning, keep refusing, and work again after a reset."""
    axis, drive = homed
    drive.step = 1000
    task = asyncio.create_task(axis.move_to(20000.0, soon))
    while not drive.position:
        await axis.status(soon)
    drive.fail(code, entry)
    with pytest.raises(error, match=text) as caught:
        await task
    assert caught.value.fields() == {"drive_code": code}
    health = await axis.health(soon)
    assert (health.state, health.error_code) == ("fault", code)
    assert text.split(maxsplit=1)[0] in health.error_meaning
    assert type(health.trouble()) is error
    axis.release()
    with pytest.raises(error):
        await axis.move_to(100.0, soon)
    await axis.reset_fault(soon)
    axis.release()
    drive.step = 2_000_000
    await axis.move_to(100.0, soon)


async def test_a_fault_whose_cause_remains_cannot_be_reset(homed: Homed, soon: Deadline) -> None:
    """It should say so after the edge; and a sound drive needs no reset."""
    axis, drive = homed
    await axis.reset_fault(soon)
    assert drive.state == 0x27
    drive.fail(0x3210, 0x01003210)
    drive.cause_remains = True
    with pytest.raises(DriveFault, match="over-voltage") as caught:
        await axis.reset_fault(soon)
    assert caught.value.code == 0x3210


async def test_an_emergency_stop_that_is_held_cannot_be_reset(homed: Homed, soon: Deadline) -> None:
    """It should be named as what it is by the reset too."""
    axis, drive = homed
    drive.fail(0x3220, 0x03043220)
    drive.motor_voltage, drive.cause_remains = False, True
    with pytest.raises(EmergencyStop, match="the motor supply was cut") as caught:
        await axis.reset_fault(soon)
    assert caught.value.drive_code == 0x3220


async def test_a_fault_that_cannot_be_read_says_which_object_was_refused(homed: Homed, soon: Deadline) -> None:
    """It should still be a fault, and not show the refusal's number as the drive's."""
    axis, drive = homed
    drive.fail(0x3210, 0x01003210)
    del drive.od[0x603F, 0]
    with pytest.raises(DriveFault, match="cannot be read") as caught:
        await axis.move_to(100.0, soon)
    assert caught.value.code == 0
    assert caught.value.fields() == {"object": "603Fh:00", "exception": 0x06020000}


# ---------------------------------------------------------------- what an error says of itself
async def test_a_refused_object_is_named_with_axis_and_abort_code(make_axis: MakeAxis, soon: Deadline) -> None:
    """It should say them as fields, for reads and for writes."""
    drive = DriveModel(3)
    for place, name in (((0x60A9, 0), "60A9h:00"), ((0x6085, 0), "6085h:00"), ((0x60A8, 0), "60A8h:00")):
        kept = drive.od.pop(place)
        with pytest.raises(DeviceRefused) as caught:
            await (await make_axis(drive)).start(soon)
        drive.od[place] = kept
        assert caught.value.code == 0x06020000
        assert caught.value.fields() == {"axis": "Z", "object": name, "exception": 0x06020000}


async def test_a_refused_register_is_named_with_axis_and_exception_code(homed: Homed, soon: Deadline) -> None:
    """It should have no object: the image is no single one."""
    axis, drive = homed
    drive.od[0x3602, 0][1] = 1
    with pytest.raises(DeviceRefused, match="illegal address") as caught:
        await axis.status(soon)
    assert caught.value.fields() == {"axis": "Z", "exception": 2}


async def test_a_silent_drive_is_named_with_axis_and_object(make_axis: MakeAxis, soon: Deadline) -> None:
    """It should say what was asked when the answer stayed away."""
    drive = DriveModel(3)
    axis = await make_axis(drive, timeout_s=0.03)
    drive.silent = True
    with pytest.raises(LinkTimeout) as caught:
        await axis.position(soon)
    assert caught.value.fields() == {"axis": "Z", "object": "6064h:00"}
    with pytest.raises(LinkTimeout) as caught:
        await axis.status(soon)
    assert caught.value.fields() == {"axis": "Z"}


async def test_a_value_that_does_not_stay_is_named_with_its_object(homed: Homed, soon: Deadline) -> None:
    """It should be a reply error about that object."""
    axis, drive = homed
    drive.put = lambda *_written: None  # type: ignore[method-assign]
    with pytest.raises(ReplyError, match="was written as 0") as caught:
        await axis.forget_homing(soon)
    assert caught.value.fields() == {"axis": "Z", "object": "2400h:20"}


async def test_a_check_of_one_axis_makes_as_many_requests_as_its_time_is_reckoned_by(
    make_line: MakeLine, open_bus: OpenBus, soon: Deadline
) -> None:
    """It should be what the budget of the check at rest counts on."""
    drive = DriveModel(3)
    line = make_line(drive.answer)
    axis = Axis(await open_bus(line), CONFIG)
    await axis.home(soon)
    before = len(line.requests)
    await axis.health(soon)
    assert len(line.requests) - before == HEALTH_REQUESTS


async def test_an_empty_error_stack_is_no_error(homed: Homed, soon: Deadline) -> None:
    """It should take abort 08000024h for an empty stack, and a missing 60F4h for no following error."""
    axis, drive = homed
    del drive.od[0x60F4, 0]
    health = await axis.health(soon)
    assert (health.error_code, health.error_meaning, health.following_error_units) == (0, "", None)
    assert health.homed


# ---------------------------------------------------------------- speed of one move
async def test_a_move_may_be_slower_than_the_axis(homed: Homed, soon: Deadline) -> None:
    """It should write the profile speed with the target, never above what was asked for, and forget it afterwards."""
    axis, drive = homed
    speed = []
    for target, at_most in ((500.0, 2000.0), (400.0, 2016.0), (300.0, 90000.0), (200.0, None)):
        await axis.begin_move(target, soon, at_most)
        while not await axis.arrived(soon):
            pass
        speed.append(drive.od[0x6081, 0][1])
    # rpm of a 2 mm screw: 2 mm/s are 60, 2.016 mm/s 60.48, the axis' own 20 mm/s are 600
    assert speed == [60, 60, 600, 600]


async def test_a_move_at_another_speed_takes_one_frame_more(make_axis: MakeAxis, soon: Deadline) -> None:
    """It should write the speed only where it changes: that is one object, some 6 ms at 115200 baud."""
    drive, written = DriveModel(3, step=100_000_000), []
    put = drive.put
    drive.put = lambda index, sub, value: [written.append(index), put(index, sub, value)][1]  # type: ignore[method-assign]
    axis = await make_axis(drive)
    await axis.home(soon)
    taken = []
    for target, at_most in ((500.0, None), (600.0, None), (700.0, 2000.0), (800.0, 2000.0)):
        written.clear()
        await axis.begin_move(target, soon, at_most)
        while not await axis.arrived(soon):
            pass
        await axis.let_go(soon)
        taken.append(list(written))
    usual = [0x607A, 0x6040, 0x6040]
    assert taken[1:] == [usual, [0x607A, 0x6081, 0x6040, 0x6040], usual]
