"""Function code 43 in the bytes of the manual, with every open point as a knob."""

import struct

import pytest

from sim_hw.bus.modbus import answer, crc16, intact, request_length, seal
from tests.sim_hw.rig import Refused, Rig

#: The manual's write example as far as its picture can be told: 12345678h to object 0123h of slave 5.
EXAMPLE = bytes.fromhex("052B0D01000123010000000004785634126735")


def raw(rig: Rig, body: str) -> str:
    reply = rig.exchange(bytes.fromhex(body))
    assert reply is not None
    return reply.hex()


def test_the_example_frame_is_whole_and_its_crc_right() -> None:
    assert request_length(EXAMPLE) == len(EXAMPLE)
    assert request_length(EXAMPLE[:12]) is None
    assert intact(EXAMPLE)
    assert seal(EXAMPLE[:-2]) == EXAMPLE


def test_the_example_is_a_well_formed_write_to_an_object_that_is_not_there() -> None:
    rig = Rig(fc43_index_order="little")
    reply = answer(rig.drive, EXAMPLE, 1.0)
    assert reply is not None
    assert reply[:-2].hex() == "05abff00060dce00000206"
    assert crc16(reply) == 0


def test_reading_the_vendor_id_byte_by_byte() -> None:
    assert raw(Rig(), "2b0d000001101801000000 04".replace(" ", "")) == "2b0d0000011018010000" + "0004" + "6c020000"


def test_writing_echoes_the_head_without_data() -> None:
    rig = Rig()
    assert raw(rig, "2b0d01000160810000000004" + "39300000") == "2b0d01000160810000000004"
    assert rig.read(0x6081, kind="I") == 12345


def test_the_write_reply_may_carry_a_zero_count() -> None:
    assert raw(Rig(fc43_write_num="zero"), "2b0d0100016081000000000439300000")[-4:] == "0000"


def test_index_order_is_a_knob_and_the_wrong_one_is_refused() -> None:
    little = Rig(fc43_index_order="little")
    assert raw(little, "2b0d00000118100100000004")[-8:] == "6c020000"
    assert raw(little, "2b0d00000110180100000004") == "abff00060dce00000206"
    assert raw(Rig(), "2b0d00000141600000000002") == "abff00060dce00000206", "4160h must not exist"


@pytest.mark.parametrize(("knob", "accepted"), [(-1, {1, 2}), (0, {0}), (1, {1}), (2, {2})])
def test_the_node_byte(knob: int, accepted: set[int]) -> None:
    rig = Rig("y", fc43_node=knob)
    for node in (0, 1, 2, 3):
        reply = raw(rig, f"2b0d0000{node:02x}604100000000" + "02")
        assert reply.startswith("2b") is (node in accepted), f"node {node}"


def test_abort_code_order_is_a_knob() -> None:
    rig = Rig(fc43_abort_order="big")
    assert raw(rig, "2b0d00000110030100000004") == "abff00060dce08000024"


@pytest.mark.parametrize(
    ("index", "sub", "value", "kind", "abort"),
    [
        (0x6041, 0, 1, "H", "06010002"),
        (0x100A, 0, 1, "H", "06010002"),
        (0x1234, 0, 1, "H", "06020000"),
        (0x6099, 3, 1, "I", "06090011"),
        (0x6081, 0, 1, "H", "06070013"),
        (0x6040, 0, 1, "I", "06070012"),
        (0x6060, 0, 3, "b", "06090030"),
        (0x6098, 0, 1, "b", "06090030"),
    ],
)
def test_refusals_carry_their_abort_code(index: int, sub: int, value: int, kind: str, abort: str) -> None:
    with pytest.raises(Refused, match=abort):
        Rig().write(index, value, sub=sub, kind=kind)


def test_a_number_needs_its_length_and_a_string_may_be_read_in_parts() -> None:
    rig = Rig()
    with pytest.raises(Refused, match="06070013"):
        rig.read(0x1018, 1, "H")
    whole = rig.ask(struct.pack(">BBBBBHBHH", 0x2B, 0x0D, 0, 0, 1, 0x100A, 0, 0, 0))[12:]
    part = rig.ask(struct.pack(">BBBBBHBHH", 0x2B, 0x0D, 0, 0, 1, 0x100A, 0, 4, 5))[12:]
    assert whole.startswith(b"FIR-v")
    assert part == whole[4:9]


def test_an_unknown_control_bit_is_answered_with_what_is_known() -> None:
    reply = raw(Rig(), "2b0d80000110180100000004")
    assert reply == "abff00030dcf01"


def test_lengths_that_do_not_match_are_exception_3() -> None:
    assert raw(Rig(), "2b0d01000160810000000004" + "3930") == "ab03"
    assert raw(Rig(), "2b0d0100016081") == "ab03"
