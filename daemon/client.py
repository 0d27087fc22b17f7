"""Client for testers in Python: a blocking client for the control socket, a listener for the events."""

from __future__ import annotations

import json
import os
import time
import uuid
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import zmq
from zmq.utils.monitor import recv_monitor_message

from daemon.domain.results import JobResult
from daemon.wire.curve_keys import KeyTrouble, PrivateKey, read_private
from daemon.wire.requests import WIRE_VERSION

DEFAULT_CONTROL = "tcp://127.0.0.1:5555"
DEFAULT_EVENTS = "tcp://127.0.0.1:5556"
KEY_VARIABLE = "REPROBE_KEY"
"""Environment variable that names the key file, where none is given."""
WILDCARDS = ("*", "0.0.0.0", "[::]")  # noqa: S104  # what a station may bind, not what we bind
HANDSHAKES = (
    zmq.EVENT_HANDSHAKE_FAILED_AUTH | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL
)
Keys = Path | PrivateKey | None
"""A client's private key, the file `reprobe keys new` wrote, or None for the one the environment names, if any."""


class NoAnswer(TimeoutError):
    """The daemon did not answer in time. Examples: it is not running, or listens elsewhere."""


class NotLetIn(NoAnswer):
    """The daemon is there but does not take this client's key. Examples: it was revoked, or none was given."""


class Refused(Exception):
    """The daemon answered with an error; `error` is its wire form (code, name, message, advice, detail)."""

    def __init__(self, error: dict[str, Any]) -> None:
        super().__init__(f"{error['name']} ({error['code']}): {error['message']}; {error['advice']}")
        self.error = error


class StandsAgain(Exception):
    """A probe pressed again after a `lift`: `contact` tells of the press that is to be measured now."""

    def __init__(self, contact: dict[str, Any]) -> None:
        super().__init__(f"the needle stands again on {contact['test_point']}, in press {contact.get('press', '?')}")
        self.contact = contact


class Client:
    """Ask the daemon. Not for several threads; a request that got no answer leaves the client usable."""

    def __init__(self, endpoint: str = DEFAULT_CONTROL, timeout_s: float = 5.0, keys: Keys = None) -> None:
        """Connect; raise `KeyTrouble` if the key cannot be used."""
        self._endpoint = endpoint
        self._timeout_s = timeout_s
        self._key = find_key(keys)
        self._context = zmq.Context()
        try:
            self._connect()
        except BaseException:  # an endpoint that is none: nobody could close what is half made
            self._context.destroy(linger=0)
            raise

    def __enter__(self) -> Self:
        """Use it in a with statement."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        """Close it."""
        self.close()

    def close(self) -> None:
        """Let go of the connection."""
        self._let_go()
        self._context.term()

    def request(self, op: str, *, timeout_s: float | None = None, **fields: Any) -> dict[str, Any]:
        """Send one request and return the reply; raise `Refused` or `NoAnswer`."""
        reply = self.raw(json.dumps({"v": WIRE_VERSION, "op": op, **fields}).encode(), timeout_s=timeout_s)
        if not reply.get("ok"):
            raise Refused(reply["error"])
        if op == "describe":
            reply["events"] = reachable(reply["events"], self._endpoint)
        return reply

    def raw(self, message: bytes, *, timeout_s: float | None = None) -> dict[str, Any]:
        """Send bytes as they are and return the decoded reply."""
        wait_s = self._timeout_s if timeout_s is None else timeout_s
        give_up_s = time.monotonic() + wait_s
        try:
            self._wait(zmq.POLLOUT, give_up_s)
            self._socket.send(message)
            self._wait(zmq.POLLIN, give_up_s)
        except NoAnswer:
            # A REQ socket that waits for a reply can send nothing else: take a new one.
            self._let_go()
            self._connect()
            raise
        reply: dict[str, Any] = json.loads(self._socket.recv())
        return reply

    def job(self, op: str, *, job_id: str | None = None, timeout_s: float = 120.0, **fields: Any) -> JobResult:
        """Run one job to its end and return its result, which may be a failed one; raise `Refused` if not taken."""
        job_id = job_id or f"{op}-{uuid.uuid4().hex[:12]}"
        reply = self.request(op, id=job_id, wait=True, timeout_s=timeout_s, **fields)
        return JobResult.model_validate(reply["result"])

    def touch(
        self, test_point: str, *, hold_ms: float = 10_000.0, job_id: str | None = None, timeout_s: float = 120.0,
        **fields: Any,
    ) -> dict[str, Any]:  # fmt: skip
        """Lower the needle onto a point and return what stands (`id`, `pressed_um`, ...) as soon as it does.

        It stays for `hold_ms`, and no longer than its lease (`lease_ms`) unless `hold` renews it. Raises
        `Refused` if the job was not taken, or failed before the needle stood.
        """
        job_id = job_id or f"touch-{uuid.uuid4().hex[:12]}"
        asked = {"test_point": test_point, "hold_ms": hold_ms, "id": job_id, **fields}
        reply = self.request("touch", wait="contact", timeout_s=timeout_s, **asked)
        result = reply.get("result") or {}
        if error := result.get("error"):
            raise Refused(error)
        contact: dict[str, Any] = reply.get("contact") or {"id": job_id, **result["detail"]["contact"]}
        return contact

    def hold(self, job_id: str, lease_ms: float = 2000.0) -> dict[str, Any]:
        """Renew the lease of a touch; raise `Refused` if its needle does not stand any more."""
        return self.request("hold", id=job_id, lease_ms=lease_ms)

    def lift(
        self, job_id: str, *, press: int | None = None, timeout_s: float = 60.0, **measured: Any
    ) -> JobResult:  # fmt: skip
        """End a touch with what was measured in it (`verdict`, `value`, `unit`) and return its result.

        `press`: in which it was measured, as the contact told it; a word that comes too late is refused then, and not
        taken for another press. Raises `StandsAgain` where a probe is not over yet, but has pressed once more.
        """
        named = {} if press is None else {"press": press}
        reply = self.request("lift", id=job_id, timeout_s=timeout_s, **measured, **named)
        if reply.get("result") is None:
            raise StandsAgain(reply["contact"])
        return JobResult.model_validate(reply["result"])

    def probe(
        self, test_point: str | None = None, *, measure: Callable[[dict[str, Any]], Mapping[str, Any]] | None = None,
        job_id: str | None = None, timeout_s: float = 120.0, **fields: Any,
    ) -> JobResult:  # fmt: skip
        """Test a point, or the best one of `net`, to its verdict and return the result: `detail["record"]` tells it.

        `measure`: is called with the contact each time the needle stands, while its lease lasts (`lease_ms`), and
        returns what it measured: `{"verdict": "pass"}`, `fail` or `open`, or `{"value": 0.4, "unit": "ohm"}`. None: the
        station measures. Raises `Refused` if the job was not taken.
        """
        asked = {**fields} if test_point is None else {"test_point": test_point, **fields}
        if measure is None:
            return self.job("probe", job_id=job_id, timeout_s=timeout_s, **asked)
        job_id = job_id or f"probe-{uuid.uuid4().hex[:12]}"
        asked |= {"measure": "tester", "wait": "contact"}
        reply = self.request("probe", id=job_id, timeout_s=timeout_s, **asked)
        while reply.get("result") is None:
            contact = reply["contact"]
            named = {"press": contact["press"]} if "press" in contact else {}
            reply = self.request("lift", id=job_id, timeout_s=timeout_s, **named, **measure(contact))
        return JobResult.model_validate(reply["result"])

    def _wait(self, ready: int, give_up_s: float) -> None:
        """Wait until the socket is ready; raise `NotLetIn` as soon as the daemon refuses the key, or `NoAnswer`."""
        poller = zmq.Poller()
        poller.register(self._socket, ready)
        poller.register(self._watch, zmq.POLLIN)
        failed = False
        while (left_ms := int((give_up_s - time.monotonic()) * 1e3)) > 0:
            found = dict(poller.poll(left_ms))
            if self._socket in found:
                return
            if self._watch in found:
                failed = True
                if recv_monitor_message(self._watch)["event"] == zmq.EVENT_HANDSHAKE_FAILED_AUTH:
                    raise NotLetIn(
                        f"{self._endpoint} does not take this key; `reprobe keys list` shows who may come in"
                    )
        if failed:
            raise NotLetIn(
                f"{self._endpoint} speaks with other keys: give the file `reprobe keys new` wrote; "
                "or too many clients are connected"
            )
        raise NoAnswer(f"no answer from {self._endpoint} in time; is the daemon running?")

    def _connect(self) -> None:
        self._socket = self._context.socket(zmq.REQ)
        self._watch = self._socket.get_monitor_socket(HANDSHAKES)
        unlock(self._socket, self._key)
        self._socket.connect(self._endpoint)

    def _let_go(self) -> None:
        self._socket.disable_monitor()
        self._watch.close(linger=0)
        self._socket.close(linger=0)


class Subscription:
    """Hear events from now on; each carries topic, seq, time and station."""

    def __init__(self, endpoint: str = DEFAULT_EVENTS, topics: tuple[str, ...] = ("",), keys: Keys = None) -> None:
        key = find_key(keys)
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.SUB)
        try:
            for topic in topics:
                self._socket.subscribe(topic)
            unlock(self._socket, key)
            self._socket.connect(endpoint)
        except BaseException:
            self._context.destroy(linger=0)
            raise

    def __enter__(self) -> Self:
        """Use it in a with statement."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        """Stop listening."""
        self._socket.close(linger=0)
        self._context.term()

    def next(self, within_s: float | None = None) -> dict[str, Any] | None:
        """Return the next event, or None if none comes in time."""
        if within_s is not None and not self._socket.poll(int(within_s * 1e3)):
            return None
        _, body = self._socket.recv_multipart()
        event: dict[str, Any] = json.loads(body)
        return event


def listen(
    endpoint: str = DEFAULT_EVENTS, topics: tuple[str, ...] = ("",), keys: Keys = None
) -> Iterator[dict[str, Any]]:
    """Yield events until closed."""
    with Subscription(endpoint, topics, keys) as heard:
        while (event := heard.next()) is not None:
            yield event


def reachable(events: str, control: str) -> str:
    """Return the event socket's endpoint as a client reaches it that reaches the control socket at `control`."""
    scheme, _, rest = events.partition("://")
    host, _, port = rest.rpartition(":")
    if scheme != "tcp" or host not in WILDCARDS:
        return events
    return f"tcp://{control.partition('://')[2].rpartition(':')[0]}:{port}"


def from_here(bound: str) -> str:
    """Return an endpoint as it is reached from the daemon's own computer; it may be bound to every address."""
    return reachable(bound, DEFAULT_CONTROL)


def find_key(keys: Keys) -> PrivateKey | None:
    """Return the key to come with; raise `KeyTrouble` if it cannot be used."""
    named = os.environ.get(KEY_VARIABLE)
    if keys is None and named:
        keys = Path(named)
    key = read_private(keys) if isinstance(keys, Path) else keys
    if key is not None and key.server is None:
        raise KeyTrouble(
            f"the key of {key.name} is no client's", "give the file `reprobe keys new` wrote for the client"
        )
    return key


def unlock(socket: zmq.Socket[Any], key: PrivateKey | None) -> None:
    """Let a socket come with a key; to be called before it connects."""
    if key is not None and key.server is not None:
        socket.setsockopt(zmq.CURVE_PUBLICKEY, key.public.encode())
        socket.setsockopt(zmq.CURVE_SECRETKEY, key.secret.encode())
        socket.setsockopt(zmq.CURVE_SERVERKEY, key.server.encode())
