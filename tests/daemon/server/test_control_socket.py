"""The control socket by itself: keys and roles, limits, hostile messages, and clients that do not behave."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import AsyncExitStack, asynccontextmanager
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import zmq
import zmq.asyncio

from daemon.client import Client, NoAnswer, NotLetIn, Refused, Subscription
from daemon.config.sections.service import ApiSection
from daemon.domain.errors import FaultCode
from daemon.domain.roles import ROLES, Caller, Role
from daemon.platform.clock import utc_now
from daemon.server.auth import Authenticator
from daemon.server.control_socket import MAX_HELD, ControlSocket
from daemon.server.event_publisher import EventPublisher
from daemon.server.keyring import Keyring
from daemon.storage.journal import Journal
from daemon.wire.curve_keys import KeyTrouble, PrivateKey, new_client, read_private, revoke
from daemon.wire.limits import GLANCE_BYTES, MAX_COMMAS, MAX_FIELDS
from daemon.wire.operations.control import CancelReply
from daemon.wire.operations.health import ReportReply
from daemon.wire.operations.table import AnyRequest
from daemon.wire.replies import Reply

WITHIN_S = 10.0


class Station:
    """Answers everything, and remembers whom; `held` is answered when `let_go` is set."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, Caller]] = []
        self.let_go = asyncio.Event()

    def at_once(self, request: AnyRequest, caller: Caller) -> Reply | None:
        self.asked.append((request.op, caller))
        return ReportReply(touches=1) if request.op == "status" else None

    async def handle(self, request: AnyRequest, _caller: Caller) -> Reply:
        if request.op == "result":
            await self.let_go.wait()
        return CancelReply(cancelled=request.op)


class Served:
    """A control socket and an event socket in this process."""

    def __init__(self, station: Station, api: ApiSection, events: EventPublisher) -> None:
        self.station, self.api, self.events = station, api, events

    async def by(self, work: Callable[[Client], Any], keys: PrivateKey | Path | None = None) -> Any:
        """Let a blocking client work in a thread."""

        def run() -> Any:
            with Client(self.api.control, timeout_s=WITHIN_S, keys=keys) as client:
                return work(client)

        return await asyncio.to_thread(run)


@asynccontextmanager
async def serving(tmp_path: Path, keys: Path | None = None, **settings: Any) -> AsyncIterator[Served]:
    api = ApiSection(
        control=f"ipc://{tmp_path}/control", events=f"ipc://{tmp_path}/events", curve=keys is not None, **settings
    )
    async with AsyncExitStack() as stack:
        journal = await Journal.open(tmp_path / "journal.sqlite")
        stack.push_async_callback(journal.close)
        context = zmq.asyncio.Context()
        stack.callback(context.destroy, linger=0)
        guard = Authenticator(api.role, Keyring(keys, {}) if keys is not None else None)
        guard.start(context)
        stack.callback(guard.stop)
        events = EventPublisher(zmq.Context(context), api.events, "s", journal, guard=guard)
        stack.callback(events.close)
        station = Station()
        control = ControlSocket(context, api, "0", station, guard)
        stack.callback(control.close)
        task = asyncio.create_task(control.serve())
        yield Served(station, api, events)
        task.cancel()
        await asyncio.wait([task])
        if not task.cancelled():
            task.result()


@pytest.fixture(autouse=True)
def no_key_by_chance(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("REPROBE_KEY", raising=False)


@pytest.fixture
def keys(tmp_path: Path) -> dict[Role, PrivateKey]:
    made = {}
    for role in ROLES:
        new_client(tmp_path / "keys", f"the-{role}", role, tmp_path / f"{role}.key")
        made[role] = read_private(tmp_path / f"{role}.key")
    return made


def _error(work: Callable[[], Any]) -> str:
    try:
        work()
    except Refused as exc:
        return str(exc.error["name"])
    return ""


def _answer(client: Client, op: str, **fields: Any) -> str:
    return _error(lambda: client.request(op, **fields))


# --- keys and roles -------------------------------------------------------------------------------------------


async def test_what_a_key_may_do_is_its_role(tmp_path: Path, keys: dict[Role, PrivateKey]) -> None:
    ops: dict[str, dict[str, Any]] = {
        "status": {}, "alerts": {}, "place": {"id": "a", "test_point": "TP1"}, "cancel": {}, "home": {"id": "h"},
        "calibrate": {"id": "c", "what": "map"}, "reset": {},
    }  # fmt: skip
    allowed = {"observe": ["status", "alerts"], "operate": ["status", "alerts", "place", "cancel"], "maintain": [*ops]}
    async with serving(tmp_path, tmp_path / "keys") as served:
        for role, key in keys.items():
            errors = await served.by(lambda c: {op: _answer(c, op, **fields) for op, fields in ops.items()}, key)
            assert errors == {op: "" if op in allowed[role] else "not_allowed" for op in ops}
        callers = {caller for _, caller in served.station.asked}
        assert callers == {Caller(f"the-{role}", role, f"the-{role}") for role in ROLES}


async def test_a_stranger_is_told_at_once_that_it_may_not_come_in(tmp_path: Path, keys: dict[Role, PrivateKey]) -> None:
    new_client(tmp_path / "elsewhere", "stranger", "maintain", tmp_path / "stranger.key")
    stranger = read_private(tmp_path / "stranger.key")
    at_our_door = PrivateKey(stranger.name, stranger.public, stranger.secret, keys["observe"].server)
    async with serving(tmp_path, tmp_path / "keys") as served:
        with pytest.raises(NotLetIn, match="does not take this key"):
            await served.by(lambda c: c.request("status"), at_our_door)
        with pytest.raises(NotLetIn, match="other keys"):
            await served.by(lambda c: c.request("status", timeout_s=0.5), stranger)
        with pytest.raises(NoAnswer):
            await served.by(lambda c: c.request("status", timeout_s=0.5))
        assert served.station.asked == []
        assert await served.by(lambda c: c.request("status"), keys["observe"])


async def test_a_key_without_the_stations_is_no_clients(tmp_path: Path, keys: dict[Role, PrivateKey]) -> None:
    with pytest.raises(KeyTrouble, match="no client's"):
        Client("ipc:///nowhere", keys=tmp_path / "keys" / "server.key")


async def test_a_key_taken_back_is_refused_also_on_an_open_connection(
    tmp_path: Path, keys: dict[Role, PrivateKey]
) -> None:
    def story(client: Client) -> list[str]:
        first = _error(lambda: client.request("status"))
        revoke(tmp_path / "keys", "the-maintain")
        return [first, _error(lambda: client.request("status")), _error(lambda: client.request("home", id="h"))]

    async with serving(tmp_path, tmp_path / "keys") as served:
        assert await served.by(story, keys["maintain"]) == ["", "key_revoked", "key_revoked"]
        assert [op for op, _ in served.station.asked] == ["status"]
        with pytest.raises(NotLetIn):
            await served.by(lambda c: c.request("status"), keys["maintain"])


def test_what_a_waiting_job_may_is_asked_of_the_list_as_it_is_now(tmp_path: Path, keys: dict[Role, PrivateKey]) -> None:
    guard = Authenticator("maintain", Keyring(tmp_path / "keys", {}))
    assert [guard.refusal(f"the-{role}", "home") is None for role in keys] == [False, False, True]
    lowered = guard.refusal("the-operate", "home")
    assert lowered is not None
    assert lowered.kind is FaultCode.NOT_ALLOWED
    revoke(tmp_path / "keys", "the-maintain")
    gone = guard.refusal("the-maintain", "home")
    assert gone is not None
    assert gone.kind is FaultCode.KEY_REVOKED
    assert Authenticator("operate").refusal("anybody", "place") is None


def _heard(subscription: Subscription, name: str) -> bool:
    """Whether an event of that name comes before the subscription is silent for a while."""
    while (event := subscription.next(0.3)) is not None:
        if event.get("event") == name:
            return True
    return False


async def test_one_whose_key_was_taken_back_hears_no_more_events_and_the_others_do(
    tmp_path: Path, keys: dict[Role, PrivateKey]
) -> None:
    async with serving(tmp_path, tmp_path / "keys") as served:
        with (
            Subscription(served.api.events, keys=keys["observe"]) as stays,
            Subscription(served.api.events, keys=keys["operate"]) as goes,
        ):
            await _until(served, "before", stays, goes)
            revoke(tmp_path / "keys", "the-operate")
            await _until(served, "after", stays)
            served.events.publish("log", {"event": "last"})
            assert await asyncio.to_thread(_heard, stays, "last")
            assert not await asyncio.to_thread(_heard, goes, "last")


async def _until(served: Served, name: str, *subscriptions: Subscription) -> None:
    """Publish until all have heard: a subscription takes a moment to stand."""
    for subscription in subscriptions:
        async with asyncio.timeout(WITHIN_S):
            heard = False
            while not heard:
                served.events.publish("log", {"event": name})
                heard = await asyncio.to_thread(_heard, subscription, name)


async def test_a_key_named_by_the_environment_is_come_with(
    tmp_path: Path, keys: dict[Role, PrivateKey], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("REPROBE_KEY", str(tmp_path / "operate.key"))
    async with serving(tmp_path, tmp_path / "keys") as served:
        assert (await served.by(lambda c: c.request("cancel")))["cancelled"] == "cancel"


async def test_without_keys_everybody_has_the_configured_role(tmp_path: Path) -> None:
    async with serving(tmp_path, role="observe") as served:
        assert await served.by(lambda c: c.request("status"))
        assert await served.by(lambda c: _error(lambda: c.request("home", id="h"))) == "not_allowed"


# --- limits ---------------------------------------------------------------------------------------------------


async def test_one_who_asks_too_fast_is_refused_by_name_and_others_are_served(tmp_path: Path) -> None:
    async with serving(tmp_path, rate_per_s=0.001, rate_burst=3) as served:
        names = await served.by(lambda c: [_error(lambda: c.request("status")) for _ in range(5)])
        assert names == ["", "", "", "rate_limited", "rate_limited"]
        assert await served.by(lambda c: _error(lambda: c.request("status"))) == ""


async def test_a_refusal_for_asking_too_fast_carries_the_tag_of_a_short_request(tmp_path: Path) -> None:
    """It should be paired by a DEALER as any answer; what is long, or no JSON, is not read for that."""
    short, long_ = {"op": "status", "id": "x", "tag": "t1"}, {"op": "status", "tag": "t2", "by": "b" * GLANCE_BYTES}
    async with serving(tmp_path, rate_per_s=0.001, rate_burst=1) as served:
        asked = [json.dumps(short).encode(), json.dumps(short).encode(), json.dumps(long_).encode(), b"[" * 2000]
        replies = await served.by(lambda c: [c.raw(message) for message in asked])
    assert [reply["error"]["name"] for reply in replies[1:]] == ["rate_limited"] * 3
    assert [(reply.get("tag"), reply.get("id")) for reply in replies[1:]] == [("t1", "x"), (None, None), (None, None)]


async def test_a_message_too_large_is_not_even_decoded(tmp_path: Path) -> None:
    async with serving(tmp_path, max_message_bytes=1024) as served:
        reply = await served.by(lambda c: c.raw(b"\xff" * 1025))
        assert reply["error"]["name"] == "message_too_large"
        assert reply["error"]["detail"]["limit_bytes"] == 1024


async def test_replies_held_for_one_client_are_bounded_and_others_are_still_served(tmp_path: Path) -> None:
    async with serving(tmp_path) as served:
        dealer = zmq.asyncio.Context.instance().socket(zmq.DEALER)
        dealer.connect(served.api.control)
        try:
            for n in range(MAX_HELD + 1):
                await dealer.send(json.dumps({"op": "result", "id": str(n)}).encode())
            refused = json.loads(await asyncio.wait_for(dealer.recv(), WITHIN_S))
            assert (refused["error"]["name"], refused["id"]) == ("busy", str(MAX_HELD))
            assert refused["error"]["detail"]["limit_held_per_client"] == MAX_HELD
            assert await served.by(lambda c: c.request("cancel"))
            served.station.let_go.set()
            answered = [json.loads(await asyncio.wait_for(dealer.recv(), WITHIN_S)) for _ in range(MAX_HELD)]
            assert {reply["id"] for reply in answered} == {str(n) for n in range(MAX_HELD)}
        finally:
            dealer.close(linger=0)


# --- clients of every kind ------------------------------------------------------------------------------------


async def test_a_dealer_may_send_with_and_without_the_empty_frame_and_many_at_once(tmp_path: Path) -> None:
    async with serving(tmp_path) as served:
        dealer = zmq.asyncio.Context.instance().socket(zmq.DEALER)
        dealer.connect(served.api.control)
        try:
            for n in range(50):
                body = json.dumps({"op": "status"} if n % 2 else {"op": "result", "id": str(n)}).encode()
                await dealer.send_multipart([b"", body] if n % 3 else [body])
            served.station.let_go.set()
            replies = [await asyncio.wait_for(dealer.recv_multipart(), WITHIN_S) for _ in range(50)]
            assert all(json.loads(frames[-1])["ok"] for frames in replies)
            assert sorted(len(frames) for frames in replies) == [1] * 17 + [2] * 33
        finally:
            dealer.close(linger=0)


HOSTILE = [
    b"", b"\x00", b"null", b'"\\ud800"', b'{"op": "\\ud800"}', b'{"op": "result", "id": "\\ud800"}', b"[" * 50_000,
    b'{"op": "status", "v": 1e999}', b'{"op": "status", "v": {}}', b'{"op": {"$ref": 1}}', b"NaN", b"\x80\x04N.",
    b'{"op": "status", "deadline_ms": NaN}', b'{"op": "results", "limit": 10000000000000000000000000000}',
]  # fmt: skip


async def test_whatever_arrives_is_answered_by_name(tmp_path: Path) -> None:
    async with serving(tmp_path) as served:
        replies = await served.by(lambda c: [c.raw(message) for message in HOSTILE])
        assert [reply["ok"] for reply in replies] == [False] * len(HOSTILE)
        assert {reply["error"]["code"] // 1000 for reply in replies} == {1}
        assert await served.by(lambda c: c.request("status"))


async def test_a_message_of_several_frames_is_answered_too(tmp_path: Path) -> None:
    async with serving(tmp_path) as served:
        dealer = zmq.asyncio.Context.instance().socket(zmq.DEALER)
        dealer.connect(served.api.control)
        try:
            for frames in ([b""], [b"", b""], [b"a", b"b"], [b"", b"{}", b"{}"]):
                await dealer.send_multipart(frames)
                reply = json.loads((await asyncio.wait_for(dealer.recv_multipart(), WITHIN_S))[-1])
                assert reply["error"]["name"] == "bad_json"
        finally:
            dealer.close(linger=0)


async def test_an_answer_of_the_daemons_own_trouble_is_internal_and_it_goes_on(tmp_path: Path) -> None:
    class Broken(Station):
        def handle(self, _request: AnyRequest, _caller: Caller) -> Awaitable[Reply]:
            raise RuntimeError("nobody thought of this")

    async with serving(tmp_path) as served:
        served.station.__class__ = Broken
        assert await served.by(lambda c: _error(lambda: c.request("cancel"))) == "internal"
        assert await served.by(lambda c: c.request("status"))


@pytest.mark.parametrize("count", [MAX_FIELDS, 80_000])
async def test_a_heap_of_unknown_fields_is_refused_in_a_small_answer(tmp_path: Path, count: int) -> None:
    """It should not validate 80,000 fields in 1 MB; by the table they took 0.97 s and were answered with 5.6 MB."""
    message = json.dumps({"op": "status", **{f"{n:05d}": 0 for n in range(count)}}).encode()
    async with serving(tmp_path) as served:
        reply = await served.by(lambda c: c.raw(message))
        assert reply["error"]["name"] == "invalid_request"
        assert len(json.dumps(reply)) < 1000
        assert served.station.asked == []


async def test_a_message_with_more_commas_than_any_request_is_not_decoded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    decoded: list[bytes] = []

    def loads(data: bytes) -> Any:
        decoded.append(data)
        return json.loads(data)

    monkeypatch.setattr("daemon.server.control_socket.json", SimpleNamespace(loads=loads))
    async with serving(tmp_path) as served:
        full = json.dumps({"op": "acknowledge", "alert": "a", "by": "," * 64, "note": "," * 500}).encode()
        assert (await served.by(lambda c: c.raw(full)))["ok"]
        assert len(decoded) == 1
        reply = await served.by(lambda c: c.raw(b"[" + b"1," * MAX_COMMAS + b",1]"))
        assert reply["error"]["name"] == "invalid_request"
        assert len(decoded) == 1


async def test_who_may_not_ask_for_it_is_told_so_whatever_its_fields_are(tmp_path: Path) -> None:
    async with serving(tmp_path, role="observe") as served:
        for bad in ({}, {"id": 7}, {"id": "c", "what": "everything"}, {"id": "c", "speed": 9}):
            assert await served.by(lambda c, bad=bad: _answer(c, "calibrate", **bad)) == "not_allowed"
        assert await served.by(lambda c: _answer(c, "status", speed=9)) == "invalid_request"


async def test_every_answer_carries_the_tag_of_its_request(tmp_path: Path) -> None:
    async with serving(tmp_path) as served:
        dealer = zmq.asyncio.Context.instance().socket(zmq.DEALER)
        dealer.connect(served.api.control)
        sent = [
            {"op": "result", "id": "held"}, {"op": "status"}, {"op": "cancel"}, {"op": "fly"}, {"op": "status", "a": 1},
        ]  # fmt: skip
        try:
            for n, request in enumerate(sent):
                await dealer.send(json.dumps({**request, "tag": f"t{n}"}).encode())
            await dealer.send(b'{"op": "status"}')
            served.station.let_go.set()
            replies = [json.loads(await asyncio.wait_for(dealer.recv(), WITHIN_S)) for _ in range(len(sent) + 1)]
        finally:
            dealer.close(linger=0)
        assert {reply["tag"]: reply["ok"] for reply in replies if "tag" in reply} == {
            "t0": True, "t1": True, "t2": True, "t3": False, "t4": False,
        }  # fmt: skip
        assert sum("tag" not in reply for reply in replies) == 1


# --- subscribers ----------------------------------------------------------------------------------------------


@pytest.fixture
def deaf(tmp_path: Path) -> Iterator[zmq.Socket[bytes]]:
    """A subscriber that reads nothing until it is asked to."""
    context = zmq.Context()
    socket = context.socket(zmq.SUB)
    socket.setsockopt(zmq.RCVHWM, 10)
    socket.subscribe("")
    socket.connect(f"ipc://{tmp_path}/events")
    yield socket
    socket.close(linger=0)
    context.term()


def _resident_mb() -> float:
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6


async def test_a_subscriber_that_never_reads_costs_bounded_memory_and_sees_by_seq_what_it_lost(
    tmp_path: Path, deaf: zmq.Socket[bytes]
) -> None:
    async with serving(tmp_path) as served:
        while not deaf.poll(10):
            served.events.publish("log", {"event": "hello"})
        body = {"event": "filler", "text": "x" * 20_000}
        served.events.publish("log", body)
        before_mb = _resident_mb()
        many = 6000
        for _ in range(many):
            served.events.publish("log", body)
            await asyncio.sleep(0)
        grown_mb = _resident_mb() - before_mb
        assert grown_mb < 60.0, "120 MB were published; a thousand events of 20 kB are 20"
        seqs = []
        while deaf.poll(100):
            seqs.append(json.loads(deaf.recv_multipart()[1])["seq"])
        last = served.events.publish("log", {"event": "last"})
        assert deaf.poll(5000)
        seqs.append(json.loads(deaf.recv_multipart()[1])["seq"])
        assert seqs[-1] == last
        assert seqs == sorted(seqs)
        assert len(seqs) < many
        assert max(b - a for a, b in pairwise(seqs)) > 1, "the gap shows"


async def test_an_event_that_is_not_as_documented_is_never_published(tmp_path: Path) -> None:
    async with serving(tmp_path) as served:
        with pytest.raises(ValueError, match="extra"):
            served.events.publish("heartbeat", {"state": "idle", "version": "1", "mood": "fine", "at": utc_now()})
