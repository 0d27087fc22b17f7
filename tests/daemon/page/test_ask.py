"""What the page asks goes out by the key of a role: the daemon refuses what an error in the page lets through."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest
import zmq
import zmq.asyncio

from daemon.client import NoAnswer, Refused
from daemon.config.sections.service import ApiSection
from daemon.domain.roles import ROLES, Caller, Role
from daemon.page import ask as asking
from daemon.page.ask import Ask, Line
from daemon.page.orders import ORDERS
from daemon.page.serve import KEY_NAMES, read_keys
from daemon.server.auth import Authenticator
from daemon.server.control_socket import ControlSocket
from daemon.server.keyring import Keyring
from daemon.wire.curve_keys import new_client, revoke
from daemon.wire.operations.control import CancelReply
from daemon.wire.operations.table import AnyRequest
from daemon.wire.replies import Reply


class Station:
    """Answers whatever the control socket lets through, the later the earlier it came."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, str, str | None]] = []
        self.turns: list[asyncio.Event] = []
        self.came = asyncio.Semaphore(0)

    def at_once(self, request: AnyRequest, caller: Caller) -> Reply | None:  # noqa: ARG002  # all takes its time
        return None

    async def handle(self, request: AnyRequest, caller: Caller) -> Reply:
        self.asked.append((caller.client, request.op, request.by))
        if request.op == "snapshot":
            turn = asyncio.Event()
            self.turns.append(turn)
            self.came.release()
            await turn.wait()
        return CancelReply(cancelled=f"{request.op} {request.by}")


class Wired:
    """A control socket that asks for keys, and the page's requests to it."""

    def __init__(self, folder: Path) -> None:
        self.keys = folder / "keys"
        for role, name in KEY_NAMES.items():
            new_client(self.keys, name, role, folder / f"{name}.key")
        self.api = api = ApiSection(control=f"ipc://{folder}/control", events=f"ipc://{folder}/events", curve=True)
        self.context = zmq.asyncio.Context()
        self.guard = Authenticator(api.role, Keyring(self.keys, {}))
        self.guard.start(self.context)
        self.station = Station()
        self.control = ControlSocket(self.context, api, "0", self.station, self.guard)
        self.serving = asyncio.create_task(self.control.serve())
        self.ask = Ask(self.context, api.control, read_keys(folder))

    async def restart(self) -> None:
        """Have the daemon go and come again; who was connected has to be let in anew."""
        self.serving.cancel()
        await asyncio.wait({self.serving})
        self.control.close()
        self.control = ControlSocket(self.context, self.api, "0", self.station, self.guard)
        self.serving = asyncio.create_task(self.control.serve())


@pytest.fixture
async def wired(tmp_path: Path) -> AsyncIterator[Wired]:
    made = Wired(tmp_path)
    yield made
    made.ask.close()
    made.serving.cancel()
    await asyncio.wait({made.serving})
    made.control.close()
    made.guard.stop()
    made.context.destroy(linger=0)


FIELDS: dict[str, dict[str, Any]] = {
    "home": {"id": "h"}, "lift": {"id": "l"}, "acknowledge": {"alert": "a", "by": "Kim"}, "light": {"colour": "red"},
    "run": {"id": "r", "plan": "six", "board_id": "b"}, "mark": {"test_point": "A", "mark": "approved", "reason": "x"},
    "place": {"id": "p", "test_point": "A"}, "correct": {"id": "c", "test_point": "A"},
    "probe": {"id": "q", "test_point": "A"}, "look": {"id": "k"}, "align": {"id": "l"},
    "jog": {"id": "j", "axis": "x", "by_um": 100.0},
    "plan": {"action": "list"},
    "calibrate": {"id": "t", "what": "tip", "tip_px": [800.0, 600.0]},
}  # fmt: skip


@pytest.mark.parametrize("role", ROLES)
async def test_the_daemon_refuses_a_forged_order_by_the_key_it_came_with(wired: Wired, role: Role) -> None:
    for order in ORDERS.values():
        fields = {"by": "Kim", **FIELDS.get(order.op, {})}
        # Of these two the operation is for operate, and what is asked for with it is not: the handlers refuse that.
        by_handler = order in (ORDERS["mended"], ORDERS["store_plan"])
        allowed = ROLES.index(role) >= ROLES.index("operate" if by_handler else order.role)
        if allowed:
            await wired.ask.request(role, order.op, **fields)
            assert wired.station.asked[-1] == (f"page-{role}", order.op, "Kim")
            continue
        with pytest.raises(Refused) as caught:
            await wired.ask.request(role, order.op, **fields)
        assert caught.value.error["name"] == "not_allowed"
    assert {client for client, _, _ in wired.station.asked} <= {f"page-{role}"}


async def test_answers_find_their_questions_whatever_their_order(wired: Wired) -> None:
    asking = [asyncio.create_task(wired.ask.request("observe", "snapshot", by=f"n{n}")) for n in range(3)]
    for _ in asking:
        await wired.station.came.acquire()
    for turn in reversed(wired.station.turns):
        turn.set()
    assert [(await one)["cancelled"] for one in asking] == [f"snapshot n{n}" for n in range(3)]


async def test_a_key_that_was_taken_back_is_refused_on_an_open_connection(wired: Wired) -> None:
    await wired.ask.request("operate", "cancel")
    revoke(wired.keys, "page-operate")
    with pytest.raises(Refused) as caught:
        await wired.ask.request("operate", "cancel")
    assert caught.value.error["name"] == "key_revoked"


async def test_a_key_that_was_taken_back_before_it_was_ever_used_is_refused_at_once(wired: Wired) -> None:
    """The daemon lets such a key in nowhere: nothing is answered, and an order would wait for its whole time."""
    revoke(wired.keys, "page-maintain")
    for _ in range(2):
        orders = [wired.ask.request("maintain", "home", id=f"h{n}", within_s=600.0) for n in range(3)]
        refusals = await asyncio.gather(*orders, return_exceptions=True)
        assert [one.error["name"] for one in refusals if isinstance(one, Refused)] == ["key_revoked"] * 3
    await wired.ask.request("operate", "cancel")
    assert [op for _, op, _ in wired.station.asked] == ["cancel"]


@pytest.fixture
def lines(monkeypatch: pytest.MonkeyPatch) -> list[Line]:
    """All lines the page makes, in their order."""
    made: list[Line] = []

    def make(*of: Any) -> Line:
        made.append(Line(*of))
        return made[-1]

    monkeypatch.setattr(asking, "Line", make)
    return made


async def turned_away(line: Line) -> None:
    """Wait until a connection that stood was refused while nobody asked."""
    for _ in range(3_000):
        if await line.turned_away():
            return
        await asyncio.sleep(0.01)
    pytest.fail("it was let in")


async def test_a_key_that_is_allowed_again_is_let_in_though_its_connection_was_refused_meanwhile(
    wired: Wired, lines: list[Line]
) -> None:
    await wired.ask.request("operate", "cancel")
    (allowed,) = (file for file in wired.keys.rglob("page-operate*") if file.is_file())
    kept = allowed.read_bytes()
    revoke(wired.keys, "page-operate")
    await wired.restart()
    await turned_away(*lines)
    allowed.write_bytes(kept)
    both = await asyncio.gather(*(wired.ask.request("operate", "cancel") for _ in range(2)))
    assert [one["ok"] for one in both] == [True, True]


async def test_an_order_whose_connection_is_refused_before_its_answer_waits_no_longer(
    wired: Wired, lines: list[Line]
) -> None:
    waiting = asyncio.create_task(wired.ask.request("observe", "snapshot", within_s=3_600.0))
    await wired.station.came.acquire()
    revoke(wired.keys, "page-observe")
    await wired.restart()
    await turned_away(*lines)
    with pytest.raises(Refused):
        await wired.ask.request("observe", "cancel")
    with pytest.raises(NoAnswer):
        await waiting


async def test_an_order_to_a_daemon_that_is_away_is_given_up_and_not_kept_for_later(tmp_path: Path) -> None:
    context = zmq.asyncio.Context()
    ask = Ask(context, f"ipc://{tmp_path}/control", None)
    with pytest.raises(NoAnswer):
        await ask.request("maintain", "home", id="h", within_s=0.2)
    late = context.socket(zmq.ROUTER)
    late.bind(f"ipc://{tmp_path}/control")
    asking = asyncio.create_task(ask.request("maintain", "reset", within_s=20.0))
    frames = await late.recv_multipart()
    assert b'"reset"' in frames[-1], "the order that was given up must not come first"
    asking.cancel()
    await asyncio.wait({asking})
    ask.close()
    context.destroy(linger=0)
