"""Run in the emulated machine: hand the pictures of a simulated camera to a v4l2loopback device.

    feed.py ENDPOINT DEVICE PERIOD_S

Each picture keeps the time at which it was exposed, told by this machine's clock and never too late: a picture that
was exposed `t` after the far clock was read was exposed at least `t` after that reading was asked for. The time stamp
is the end of the exposure, as if reading out took no time; the driver then takes a picture for older than it is.
"""

from __future__ import annotations

import fcntl
import json
import mmap
import os
import socket
import struct
import sys
import time
from collections import deque
from typing import Any

import zmq

WIDTH_PX, HEIGHT_PX, BUFFERS, IMAGE_BYTES = 1600, 1200, 4, 4_000_000
ANSWER_WITHIN_MS = 30_000
RECENT = 50
"""Readings of the far clock that count: the best of them is the offset. Clocks drift, so it is not the best ever."""
CONTROLS = {
    "auto_exposure": 0, "exposure_us": 20_000, "auto_white_balance": 0, "white_balance_k": 4600,
    "auto_focus": 0, "focus": 120,
}  # fmt: skip
"""Set here, for a loopback device has no such controls."""
OUTPUT, MMAP, NO_FIELD = 2, 1, 1
FORMAT = struct.Struct("=II7I")
"""The head of v4l2_format with its v4l2_pix_format: type, padding, width, height, format, field, line, image, space."""
REQUEST = struct.Struct("=5I")
BUFFER = struct.Struct("=5I4xqq16xIIQI12x")
"""v4l2_buffer: index, type, bytesused, flags, field, seconds, microseconds, sequence, memory, offset, length."""


def _both_ways(number: int, size: int) -> int:
    return 3 << 30 | size << 16 | ord("V") << 8 | number


S_FMT, REQBUFS = _both_ways(5, 208), _both_ways(8, REQUEST.size)
QUERYBUF, QBUF = _both_ways(9, BUFFER.size), _both_ways(15, BUFFER.size)
STREAMON = 1 << 30 | 4 << 16 | ord("V") << 8 | 18


class FarCamera:
    """The simulated camera, and how its clock stands to this machine's."""

    def __init__(self, endpoint: str) -> None:
        self._socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.DEALER)
        self._socket.connect(endpoint)
        self._offsets_s: deque[float] = deque(maxlen=RECENT)
        self.ask(op="open", width=WIDTH_PX, height=HEIGHT_PX, encoding="mjpg", buffers=1)
        for name, value in CONTROLS.items():
            self.ask(op="set", control=name, value=value)

    def ask(self, **request: Any) -> tuple[dict[str, Any], bytes]:
        """Send one request and return the reply and what comes with it."""
        asked_s = time.monotonic()
        self._socket.send_json({"v": 1, "n": 0, **request})
        if not self._socket.poll(ANSWER_WITHIN_MS):
            raise SystemExit(f"the camera does not answer {request}")
        head, *rest = self._socket.recv_multipart()
        reply: dict[str, Any] = json.loads(head)
        if not reply["ok"]:
            raise SystemExit(f"{request}: {reply['error']}")
        self._offsets_s.append(asked_s - reply["clock_s"])
        return reply, rest[0] if rest else b""

    def picture(self) -> tuple[float, bytes]:
        """Return the end of a picture's exposure by this machine's clock, and its JPEG bytes."""
        reply, _ = self.ask(op="grab", timeout_ms=10_000)
        _, picture = self.ask(op="retrieve")
        end_s = reply["exposure_start_s"] + reply["exposure_us"] / 1e6
        return min(end_s + max(self._offsets_s), time.monotonic()), picture


class Loopback:
    """The writing side of the device."""

    def __init__(self, device: str) -> None:
        self._file = os.open(device, os.O_RDWR)
        wanted = bytearray(208)
        jpeg = int.from_bytes(b"MJPG", "little")
        FORMAT.pack_into(wanted, 0, OUTPUT, 0, WIDTH_PX, HEIGHT_PX, jpeg, NO_FIELD, 0, IMAGE_BYTES, 8)
        fcntl.ioctl(self._file, S_FMT, wanted)
        fcntl.ioctl(self._file, REQBUFS, bytearray(REQUEST.pack(BUFFERS, OUTPUT, MMAP, 0, 0)))
        self._written = 0
        self._maps = [self._map(index) for index in range(BUFFERS)]
        fcntl.ioctl(self._file, STREAMON, struct.pack("=I", OUTPUT))

    def write(self, stamp_s: float, picture: bytes) -> None:
        """Give a picture to whoever reads, with a time stamp of CLOCK_MONOTONIC. The device keeps no buffer back."""
        index = self._written % BUFFERS
        self._maps[index][: len(picture)] = picture
        seconds, micros = divmod(round(stamp_s * 1e6), 1_000_000)
        fcntl.ioctl(self._file, QBUF, self._buffer(index, len(picture), seconds, micros))
        self._written += 1

    def _map(self, index: int) -> mmap.mmap:
        known = self._buffer(index)
        fcntl.ioctl(self._file, QUERYBUF, known)
        *_, offset, length = BUFFER.unpack(known)
        return mmap.mmap(self._file, length, offset=offset)

    def _buffer(self, index: int, length: int = 0, seconds: int = 0, micros: int = 0) -> bytearray:
        return bytearray(BUFFER.pack(index, OUTPUT, length, 0, NO_FIELD, seconds, micros, self._written, MMAP, 0, 0))


def _tell_ready() -> None:
    """Tell the service manager that there is a picture to be had."""
    if "NOTIFY_SOCKET" in os.environ:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
            manager.sendto(b"READY=1", os.environ["NOTIFY_SOCKET"])


def main(endpoint: str, device: str, period_s: float) -> None:
    """Hand over one picture a period until ended."""
    camera, loopback = FarCamera(endpoint), Loopback(device)
    loopback.write(*camera.picture())
    _tell_ready()
    while True:
        began_s = time.monotonic()
        loopback.write(*camera.picture())
        time.sleep(max(0.0, began_s + period_s - time.monotonic()))


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], float(sys.argv[3]))
