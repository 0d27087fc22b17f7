"""A station that is played: it speaks the wire as documented, and says what a test wants a page to hear.

For what no simulated station can be brought to say: a day's events in a moment, names with markup, a board of 5,000
points, another version, a clock that is wrong. Replies are the examples of `doc/wire.md`, changed by `replies`.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Mapping
from copy import deepcopy
from datetime import UTC, datetime, timedelta
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import zmq

from daemon.wire.live import TOPIC
from daemon.wire.operations.table import OPERATIONS

BEAT_MS = 400
KEPT = 50
"""Results that the station remembers."""
QUIET: dict[str, dict[str, Any]] = {
    "snapshot": {"run": None, "contact": None, "last_result": None, "state": "idle", "lifecycle": "ready",
                 "fault": None, "running": None, "queued": 0},
    "history": {"results": [], "more": False}, "alerts": {"alerts": [], "standing": [], "healthy": True},
}  # fmt: skip
"""A station at which nothing goes on."""


class PlayedStation:
    """Control, events and live pictures of a station, in a thread of their own."""

    def __init__(self, folder: Path) -> None:
        self.control, self._events, self._live = (f"ipc://{folder}/{name}" for name in ("control", "events", "live"))
        self.replies: dict[str, dict[str, Any]] = deepcopy(QUIET)
        self.missing: dict[str, tuple[str, ...]] = {}
        """Fields that an answer lacks."""
        self.refusal: dict[str, Any] | None = None
        """What every request is refused with."""
        self.asked: list[dict[str, Any]] = []
        self.ahead = timedelta()
        """How far the station's clock is ahead of this computer's."""
        self.silent = False
        self.seq = 0
        self.result: dict[str, Any] = dict(OPERATIONS.row("history").example_reply["results"][0])
        self._say: SimpleQueue[tuple[str, dict[str, Any], bytes]] = SimpleQueue()
        self._context = zmq.Context()
        self._wake, wakened = self._context.socket(zmq.PUSH), self._context.socket(zmq.PULL)
        wakened.bind("inproc://say")
        self._wake.connect("inproc://say")
        self._thread = threading.Thread(target=self._play, args=(wakened,))
        self._thread.start()

    @property
    def now(self) -> str:
        return (datetime.now(UTC) + self.ahead).isoformat(timespec="milliseconds")

    def lay(self, board: dict[str, Any] | None) -> None:
        """Have another board under test."""
        self.replies["describe"] = {"board": board}
        self.replies["snapshot"]["board_revision"] = f"revision {self.seq}"
        self.ask_again()

    def ask_again(self) -> None:
        """Say what a page asks for a snapshot after."""
        now = self.replies["snapshot"]
        self.say("state", state=now["state"], was="look", event="seen", job=None, fault=now["fault"])

    def say(self, topic: str, **fields: Any) -> None:
        """Publish an event."""
        self._put(topic, fields)

    def show(self, jpeg: bytes, **header: Any) -> None:
        """Publish a live picture."""
        self._put("", header, jpeg)

    def end(self) -> None:
        self._put("end", {})
        self._thread.join()
        self._wake.close(linger=0)
        self._context.term()

    def _put(self, topic: str, fields: dict[str, Any], jpeg: bytes = b"") -> None:
        self._say.put((topic, fields, jpeg))
        self._wake.send(b"")

    def _play(self, wakened: zmq.Socket[bytes]) -> None:
        control, events, live = (self._context.socket(kind) for kind in (zmq.ROUTER, zmq.PUB, zmq.PUB))
        events.setsockopt(zmq.SNDHWM, 0)
        for socket, endpoint in ((control, self.control), (events, self._events), (live, self._live)):
            socket.bind(endpoint)
        poller = zmq.Poller()
        for socket in (wakened, control):
            poller.register(socket, zmq.POLLIN)
        going_on = True
        while going_on:
            ready = dict(poller.poll(BEAT_MS))
            if not ready and not self.silent:
                self._publish(events, "heartbeat", {"state": self.replies["snapshot"]["state"], "version": "0.1.0"})
            if control in ready:
                *route, asked = control.recv_multipart()
                if not self.silent:
                    control.send_multipart([*route, json.dumps(self._answer(json.loads(asked))).encode()])
            if wakened in ready:
                wakened.recv()
                going_on = self._say_one(events, live)
        for socket in (wakened, control, events, live):
            socket.close(linger=0)

    def _say_one(self, events: zmq.Socket[bytes], live: zmq.Socket[bytes]) -> bool:
        """Say what is next; whether more may come."""
        topic, fields, jpeg = self._say.get()
        if topic == "end":
            return False
        if jpeg:
            live.send_multipart([TOPIC, json.dumps(fields).encode(), jpeg])
        else:
            self._publish(events, topic, fields)
        return True

    def _publish(self, events: zmq.Socket[bytes], topic: str, fields: Mapping[str, Any]) -> None:
        said = {"v": 1, "topic": topic, "seq": self.seq, "time": self.now, "station": "station-1", **fields}
        self.seq += 1
        if topic == "result":
            history = self.replies["history"]
            history["results"] = [said, *history["results"]][:KEPT]
        events.send_multipart([topic.encode(), json.dumps(said).encode()])

    def _answer(self, asked: dict[str, Any]) -> dict[str, Any]:
        self.asked.append(asked)
        envelope = {"v": 1, "version": "0.1.0", "ok": self.refusal is None, "tag": asked["tag"]}
        if self.refusal is not None:
            return {**envelope, "error": self.refusal}
        own: dict[str, Any] = {
            "describe": {"events": self._events, "live": self._live},
            "snapshot": {"next_seq": self.seq},
        }
        row = OPERATIONS.row(asked["op"])
        said = {**row.example_reply, **envelope, **own.get(row.op, {}), **self.replies.get(row.op, {})}
        return {name: value for name, value in said.items() if name not in self.missing.get(row.op, ())}
