"""Half-open connections: peers that connect to the control socket and say nothing, or begin and stop, beside a job."""

from __future__ import annotations

import random
import socket
from contextlib import ExitStack

from daemon.client import NoAnswer
from tests.bench.faults.station import Station

GREETINGS = (
    b"",
    b"\xff",
    b"\xff" + bytes(8) + b"\x7f",
    b"\xff" + bytes(8) + b"\x7f\x03\x00",
    b"GET / HTTP/1.1\r\n\r\n",
)
LEAST, MOST = 50, 400
ANSWER_S = 10.0


def one(station: Station, chance: random.Random) -> None:
    """Hold so many of them while a job runs; who comes after them is answered all the same."""
    station.recover()
    request = station.request("place", "beside", undisturbed=True, wait=True)
    address = station.rig.control.removeprefix("ipc://")
    with ExitStack() as held:
        for _ in range(chance.randint(LEAST, MOST)):
            peer = held.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
            peer.settimeout(ANSWER_S)
            try:
                peer.connect(address)
                peer.sendall(chance.choice(GREETINGS))
            except OSError:
                continue  # parted from already
        with station.sending(request) as replies, station.rig.client(ANSWER_S) as newcomer:
            try:
                newcomer.request("status")
            except NoAnswer:
                station.found("other", f"a client that came after half-open peers had no answer in {ANSWER_S:g} s")
    station.must_have_worked(request, replies[0])
    station.recover()
    station.judge_item()
