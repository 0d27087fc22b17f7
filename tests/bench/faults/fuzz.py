"""Fuzz: messages as they must not be, between good ones, many on their way at once; each has one answer."""

from __future__ import annotations

import itertools
import json
import random
from collections import Counter
from typing import Any

import zmq

from tests.bench.faults.messages import messages
from tests.bench.faults.station import Station

BATCH = 2500
"""Messages between two judgements; one such batch is what is repeated."""
WINDOW = 48
ANSWER_MS = 30_000


def one(station: Station, chance: random.Random, count: int) -> None:
    """Send so many messages, wait for as many answers, and judge."""
    station.recover()
    number = itertools.count()

    def job(op: str) -> dict[str, Any]:
        return {"op": op} if op == "reset" else station.request(op, f"job-{next(number)}")

    names = _exchange(station, itertools.islice(messages(chance, job), count))
    if names["internal"]:
        station.found("other", f"{names['internal']} answers are `internal`")
    station.client.raw(b'{"op": "reset"}', timeout_s=60.0)
    station.recover()
    station.judge_item()


def _exchange(station: Station, sent: Any) -> Counter[str]:
    """Keep a window of messages on their way; return how often each error was the answer."""
    names: Counter[str] = Counter()
    context = zmq.Context()
    socket = context.socket(zmq.DEALER)
    socket.connect(station.rig.control)
    open_ = 0
    try:
        for message in itertools.chain(sent, [None]):
            if message is not None:
                socket.send_multipart([b"", message])
                open_ += 1
            while open_ >= (WINDOW if message is not None else 1):
                if not socket.poll(ANSWER_MS):
                    station.found("other", f"{open_} messages had no answer within {ANSWER_MS / 1e3:g} s")
                    return names
                reply = json.loads(socket.recv_multipart()[-1])
                open_ -= 1
                station.ledger.answered(reply, station.item)
                names[(reply.get("error") or {}).get("name", "ok")] += 1
    finally:
        socket.close(linger=0)
        context.term()
    return names
