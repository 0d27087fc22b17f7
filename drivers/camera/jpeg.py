"""JPEG pictures of a stream: decoded where they arrived whole; what lost bytes on its way is none."""

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.camera.contract import Pixels

_START, _END, _SCAN, _INTERVAL, _HUFFMAN = b"\xff\xd8", b"\xff\xd9", 0xDA, 0xDD, 0xC4
# Baseline and extended, the two that may code a picture in one scan (ITU-T T.81, table B.1)
_FRAMES = (0xC0, 0xC1)
_RESTART = 0xD0
_RESTARTS = 8


def decode_jpeg(data: bytes, width_px: int, height_px: int) -> Pixels | None:
    """Decode one JPEG picture; None when it is torn, cut short or not of this size."""
    if not is_whole(data):
        return None
    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    except cv2.error:
        return None
    if pixels is None or pixels.shape != (height_px, width_px, 3):
        return None
    return np.asarray(pixels, np.uint8)


def is_whole(data: bytes) -> bool:
    """Tell by its marks whether a JPEG picture arrived whole; a cut one often decodes with a grey rest."""
    return data.rstrip(b"\0").endswith(_END) and restarts_complete(data)


def shown_anywhere(data: bytes) -> bytes | None:
    """Return a whole JPEG picture as any program shows it, without a camera's padding behind it.

    None for one without Huffman tables of its own: Motion JPEG may leave them out, and only some decoders know them.
    """
    with_tables = any(code == _HUFFMAN for code, _start, _end in _segments(data))
    return data.rstrip(b"\0") if with_tables else None


def restarts_complete(data: bytes) -> bool:
    """Tell whether a picture has all its restart marks, in their order; one that was made without any has.

    Many cameras put such a mark after every so many blocks. A decoder that misses some goes on at the next one, and
    shows the rest displaced, or grey, without a word.
    """
    interval = blocks = 0
    colours = b""
    for code, start, end in _segments(data):
        body = data[start:end]
        if code == _INTERVAL:
            interval = int.from_bytes(body[:2], "big")
        elif code in _FRAMES:
            blocks, colours = _blocks(body), body[5:6]
        elif code == _SCAN:
            if not interval or not blocks or body[:1] != colours:  # a scan of some colours only has blocks of its own
                return True
            between = -(-blocks // interval) - 1
            marks = _restarts(data, end)
            # Some cameras put one behind the last blocks, too
            in_order = np.array_equal(marks, np.arange(len(marks)) % _RESTARTS)
            return in_order and len(marks) in (between, between + 1)
    return True


def _segments(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Give code, begin and end of each segment's body, up to the first scan's."""
    at = len(_START)
    while at + 4 <= len(data) and data[at] == 0xFF:
        if data[at + 1] == 0xFF:  # any number of them may fill up before a mark's code (B.1.1.2)
            at += 1
            continue
        code, length = data[at + 1], int.from_bytes(data[at + 2 : at + 4], "big")
        yield code, at + 4, at + 2 + length
        if code == _SCAN:
            return
        at += 2 + length


def _blocks(frame: bytes) -> int:
    """Return how many units a frame header's picture is coded in, each of some blocks of all its colours; T.81, A.2."""
    if len(frame) < 6 or len(frame) < 6 + 3 * frame[5] or not frame[5]:
        return 0
    height, width = int.from_bytes(frame[1:3], "big"), int.from_bytes(frame[3:5], "big")
    # One colour alone is coded block by block, whatever its sampling
    samplings = [frame[7 + 3 * k] for k in range(frame[5])] if frame[5] > 1 else [0x11]
    across, down = 8 * max(s >> 4 for s in samplings), 8 * max(s & 15 for s in samplings)
    return -(-width // across) * -(-height // down) if across and down else 0


def _restarts(data: bytes, start: int) -> NDArray[np.int64]:
    """Return the numbers of the restart marks of a scan; in its data any other 0xFF is followed by 0."""
    scan = np.frombuffer(data[start:], np.uint8)
    marks = scan[1:][scan[:-1] == 0xFF].astype(np.int64) - _RESTART
    return np.asarray(marks[(marks >= 0) & (marks < _RESTARTS)])
