"""The process image, its mapping, and the register function codes."""

import struct

import pytest

from tests.sim_hw.rig import Refused, Rig

TX = 5000
RX = 6000
DEFAULT_TX = [0x60410010, 0x00050008, 0x60610008, 0x60640020, 0x60440010, 0x60FD0020]


def remap(rig: Rig, mapping: int, entries: list[int]) -> None:
    rig.write(mapping, 0, kind="B")
    for sub, entry in enumerate(entries, start=1):
        rig.write(mapping, entry, sub=sub)
    rig.write(mapping, len(entries), kind="B")


def write_registers(rig: Rig, start: int, values: list[int]) -> bytes:
    data = struct.pack(f">{len(values)}H", *values)
    return rig.ask(struct.pack(">BHHB", 16, start, len(values), len(data)) + data)


def test_the_default_transmit_image_is_the_manuals_example() -> None:
    rig = Rig()
    assert [rig.read(0x3602, sub, "I") for sub in range(1, 7)] == DEFAULT_TX
    rig.home(21)
    rig.t_s = 30.0
    values = rig.registers(TX, 7)
    assert values[0] == rig.status()
    assert values[1] == 6, "dummy byte, then the mode shown"
    assert (values[2] << 16 | values[3]) == rig.read(0x6064)
    assert (values[5] << 16 | values[6]) == rig.read(0x60FD, kind="I")
    assert rig.ask(struct.pack(">BHH", 4, TX, 7))[2:] == struct.pack(">7H", *values)


def test_both_ways_to_read_a_position_agree_in_either_word_order() -> None:
    for order, places in (("high", (2, 3)), ("low", (3, 2))):
        rig = Rig(word_order=order, x_start_um=9_000.0)
        rig.home(21)
        rig.ramps()
        rig.enable(1)
        rig.order(150_000.0)
        rig.run_until(1 << 10)
        values = rig.registers(TX, 8)
        assert values[places[0]] << 16 | values[places[1]] == rig.read(0x6064) == rig.units(150_000.0)


def test_a_rewritten_mapping_moves_the_registers() -> None:
    rig = Rig()
    remap(rig, 0x3602, [0x60640020, 0x60410010])
    values = rig.registers(TX, 4)
    assert values[0] << 16 | values[1] == rig.read(0x6064) & 0xFFFFFFFF
    assert values[2] == rig.status()
    with pytest.raises(Refused, match="02"):
        rig.registers(TX, 5)


@pytest.mark.parametrize(
    ("mapping", "entry", "abort"),
    [
        (0x3602, 0x60640010, "06040041"),  # wrong length
        (0x3602, 0x607A0020, "06040041"),  # not for this direction
        (0x3502, 0x60410010, "06040041"),
        (0x3602, 0x70000010, "06040041"),  # no such object
    ],
)
def test_what_cannot_be_mapped_is_refused(mapping: int, entry: int, abort: str) -> None:
    rig = Rig()
    rig.write(mapping, 0, kind="B")
    with pytest.raises(Refused, match=abort):
        rig.write(mapping, entry, sub=1)


def test_a_mapping_in_force_cannot_be_edited() -> None:
    with pytest.raises(Refused, match="08000022"):
        Rig().write(0x3602, 0x60640020, sub=1)
    rig = Rig()
    with pytest.raises(Refused, match="06090030"):
        rig.write(0x3602, 17, kind="B")


def test_one_write_carries_target_and_controlword_together() -> None:
    rig = Rig(x_start_um=10_000.0)
    rig.ramps()
    rig.enable(1)
    remap(rig, 0x3502, [0x60400010, 0x00060010, 0x607A0020])
    target = rig.units(3_000.0)
    write_registers(rig, RX, [0x1F, 0, target >> 16, target & 0xFFFF])
    rig.t_s += 0.002
    rig.run_until(1 << 10)
    assert rig.read(0x6064) == target


def test_fc23_writes_first_and_reads_the_result() -> None:
    rig = Rig()
    remap(rig, 0x3502, [0x60400010, 0x00060010])
    reply = rig.ask(struct.pack(">BHHHHBHH", 23, TX, 2, RX, 2, 4, 0x06, 0))
    assert struct.unpack(">BBHH", reply)[2] & 0x6F == 0x21


def test_fc6_writes_any_single_register_of_the_image() -> None:
    rig = Rig()
    remap(rig, 0x3502, [0x607A0020, 0x60400010])
    rig.ask(struct.pack(">BHH", 6, RX + 1, 0x1234))
    rig.ask(struct.pack(">BHH", 6, RX + 2, 0x06))
    assert rig.read(0x607A) == (4000 & ~0xFFFF) | 0x1234
    assert rig.status() & 0x6F == 0x21


@pytest.mark.parametrize(
    ("pdu", "code"),
    [
        (struct.pack(">BHH", 3, TX + 1, 2), 2),  # not on a 4-byte border
        (struct.pack(">BHH", 3, 100, 2), 2),
        (struct.pack(">BHH", 3, TX, 0), 3),
        (struct.pack(">BHH", 3, TX, 126), 3),
        (struct.pack(">BHHB", 16, TX, 2, 4) + bytes(4), 2),
        (struct.pack(">BHHB", 16, RX, 2, 3) + bytes(3), 3),
        (b"\x05\x00\x00\xff\x00", 1),  # no coils on a drive
        (b"\x2b\x0e\x01\x00", 1),  # the other MEI type
        (b"\x65\x55", 1),
    ],
)
def test_exceptions_name_what_is_wrong(pdu: bytes, code: int) -> None:
    reply = Rig().exchange(pdu)
    assert reply == bytes([pdu[0] | 0x80, code])


def test_a_value_the_object_refuses_is_exception_4() -> None:
    rig = Rig()
    remap(rig, 0x3502, [0x60600008, 0x00050008, 0x00060010])
    with pytest.raises(Refused, match="04"):
        write_registers(rig, RX, [0x7F00, 0])


def test_nanoj_inputs_are_registers_from_3000() -> None:
    rig = Rig()
    write_registers(rig, 3000 + 2 * 31, [0x1234, 0x5678])
    assert rig.read(0x2400, 0x20) == 0x12345678
    assert rig.registers(3000 + 2 * 31, 2) == [0x1234, 0x5678]
    with pytest.raises(Refused, match="02"):
        write_registers(rig, 3001, [0, 0])


def test_the_default_receive_image_can_be_written_whole_for_every_step() -> None:
    rig = Rig(x_start_um=10_000.0)
    rig.ramps()
    target = rig.units(3_000.0)
    for word in (0x06, 0x06, 0x07, 0x0F, 0x1F):
        image = [word, 0x0001, 0, 0, target >> 16, target & 0xFFFF, 0, 600, 200, 0, 0, 0]
        write_registers(rig, RX, image)
        rig.t_s += 0.003
    assert rig.status() & (1 << 12), "the repeated mode does not swallow the set-point"
    rig.run_until(1 << 10)
    assert rig.read(0x6064) == target
