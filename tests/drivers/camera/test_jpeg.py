"""JPEG pictures that lost bytes on their way are none, whole ones always are."""

import cv2
import numpy as np
import pytest

from drivers.camera.jpeg import decode_jpeg, restarts_complete, shown_anywhere

SAMPLINGS = (
    cv2.IMWRITE_JPEG_SAMPLING_FACTOR_411,
    cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420,
    cv2.IMWRITE_JPEG_SAMPLING_FACTOR_422,
    cv2.IMWRITE_JPEG_SAMPLING_FACTOR_440,
    cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
)
SIZES = ((320, 240), (333, 217), (17, 9))


def encoded(
    width: int, height: int, interval: int, sampling: int = SAMPLINGS[2], *, progressive: bool = False
) -> bytes:
    picture = np.random.default_rng(width).integers(0, 255, (height, width, 3), np.uint8)
    options = [
        cv2.IMWRITE_JPEG_RST_INTERVAL, interval, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, sampling,
        cv2.IMWRITE_JPEG_PROGRESSIVE, int(progressive),
    ]  # fmt: skip
    good, data = cv2.imencode(".jpg", picture, options)
    assert good
    return bytes(data.tobytes())


def restarts(data: bytes) -> list[int]:
    """Places of the restart marks of a picture whose headers have nothing that looks like one."""
    return [
        at for at in range(data.index(b"\xff\xda"), len(data) - 1) if data[at] == 0xFF and 0xD0 <= data[at + 1] < 0xD8
    ]


@pytest.mark.parametrize("interval", [0, 1, 3, 7, 20, 10_000])
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("sampling", SAMPLINGS)
def test_a_whole_picture_is_one_however_it_was_made(size: tuple[int, int], interval: int, sampling: int) -> None:
    assert decode_jpeg(encoded(*size, interval, sampling), *size) is not None


def test_a_picture_in_several_scans_is_not_judged_by_its_restart_marks() -> None:
    data = encoded(320, 240, 4, progressive=True)
    assert decode_jpeg(data, 320, 240) is not None


@pytest.mark.parametrize("lost", [1, 2, 7, 8, 16])
@pytest.mark.parametrize("first", [0, 3, 11])
def test_a_picture_that_lost_a_part_of_its_middle_is_none(first: int, lost: int) -> None:
    """It should see that marks are missing, also so many that those left count on; a decoder alone takes it."""
    data = encoded(320, 240, 7)
    marks = restarts(data)
    torn = data[: marks[first] + 10] + data[marks[first + lost] + 10 :]
    assert cv2.imdecode(np.frombuffer(torn, np.uint8), cv2.IMREAD_COLOR) is not None
    assert decode_jpeg(torn, 320, 240) is None


def test_a_mark_behind_the_last_blocks_is_no_trouble_and_more_of_them_are() -> None:
    """It should bear what some cameras send."""
    data = encoded(320, 240, 7)
    (last,) = restarts(data)[-1:]
    after = bytes([0xFF, 0xD0 + (data[last + 1] - 0xD0 + 1) % 8])
    assert restarts_complete(data[:-2] + after + data[-2:])
    assert not restarts_complete(data[:-2] + after + after + data[-2:])


@pytest.mark.parametrize("cut", range(0, 700, 7))
def test_any_bytes_are_a_picture_or_none(cut: int) -> None:
    """It should raise nothing, whatever a header says."""
    data = encoded(17, 9, 1)
    decode_jpeg(data[:cut] + b"\xff\xd9", 17, 9)
    spoilt = bytearray(data)
    spoilt[cut % len(data)] ^= 0xFF
    decode_jpeg(bytes(spoilt), 17, 9)


@pytest.mark.parametrize("before", [b"\xff\xc0", b"\xff\xdd", b"\xff\xda"])
def test_fill_bytes_before_a_mark_hide_no_lost_part(before: bytes) -> None:
    """It should read on where any number of 0xFF comes before a mark's own (ITU-T T.81, B.1.1.2)."""
    data = encoded(320, 240, 7)
    at = data.index(before)
    filled = data[:at] + b"\xff\xff\xff" + data[at:]
    marks = restarts(data)
    torn = data[: marks[3] + 10] + data[marks[5] + 10 :]
    assert decode_jpeg(filled, 320, 240) is not None
    assert decode_jpeg(torn[:at] + b"\xff\xff\xff" + torn[at:], 320, 240) is None


def test_a_whole_baseline_picture_with_a_scan_for_each_colour_is_one() -> None:
    """It should not hold the marks of all scans against the blocks of one (ITU-T T.81, A.2.2)."""
    grey = np.random.default_rng(1).integers(0, 255, (40, 64), np.uint8)
    data = cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_RST_INTERVAL, 3])[1].tobytes()
    frame, scan = data.index(b"\xff\xc0"), data.index(b"\xff\xda")
    length = int.from_bytes(data[frame + 2 : frame + 4], "big")
    colours = b"".join(bytes([colour, 0x11, 0]) for colour in (1, 2, 3))
    header = data[frame + 4 : frame + 9] + b"\x03" + colours
    scans = b"".join(b"\xff\xda\x00\x08\x01" + bytes([c]) + data[scan + 6 : -2] for c in (1, 2, 3))
    picture = data[:frame] + b"\xff\xc0\x00\x11" + header + data[frame + 2 + length : scan] + scans + b"\xff\xd9"
    assert cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR) is not None
    assert decode_jpeg(picture, 64, 40) is not None


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("sampling", [0x11, 0x22, 0x41])
def test_a_picture_without_colour_is_held_against_its_restart_marks_too(size: tuple[int, int], sampling: int) -> None:
    """It should count its blocks one by one, whatever sampling its header names (ITU-T T.81, A.2.2)."""
    width, height = size
    grey = np.random.default_rng(width).integers(0, 255, (height, width), np.uint8)
    data = bytearray(cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_RST_INTERVAL, 2])[1].tobytes())
    data[data.index(b"\xff\xc0") + 11] = sampling
    whole, marks = bytes(data), restarts(bytes(data))
    assert decode_jpeg(whole, *size) is not None
    assert not restarts_complete(whole[: marks[0]] + whole[marks[1] :])


@pytest.mark.parametrize("progressive", [False, True])
def test_a_picture_with_its_own_tables_is_shown_anywhere_without_padding(progressive: bool) -> None:
    data = encoded(320, 240, 0, progressive=progressive)
    assert shown_anywhere(data + bytes(700)) == data


def test_motion_jpeg_without_its_tables_is_shown_by_no_browser() -> None:
    """Its decoder is to know them: this project's does."""
    data = encoded(320, 240, 0)
    at = data.index(b"\xff\xc4")
    while data[at : at + 2] == b"\xff\xc4":
        data = data[:at] + data[at + 2 + int.from_bytes(data[at + 2 : at + 4], "big") :]
    assert decode_jpeg(data, 320, 240) is not None
    assert shown_anywhere(data) is None
