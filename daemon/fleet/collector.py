"""Collector: batches of all stations, stored in the database, and each station told how far it is stored.

One works, others wait for the database's lock. It keeps nothing of its own, and sends nothing down but that.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import aiomqtt
import asyncpg
import structlog

from daemon.fleet.batch import Batch, Nonsense
from daemon.fleet.broker import Broker, Patience, connected
from daemon.fleet.counts import Counts
from daemon.fleet.database import Answer, Arrived, Database, Refused, State
from daemon.fleet.incoming import Arrival, Incoming
from daemon.fleet.rollups import keep_rolling
from daemon.fleet.topics import BadName, StationPath, everywhere

GROUP_S = 0.02
"""So long is waited for more to be stored together."""
HOUSE_S = 3600.0
DATABASE_S, COMMAND_S = 5.0, 60.0
Trouble = (aiomqtt.MqttError, asyncpg.PostgresError, asyncpg.InterfaceError, OSError)
log = structlog.get_logger(__name__)


@dataclass(frozen=True)
class Keeping:
    """How long what is kept."""

    recent_days: int = 7
    record_months: int | None = None


class Collector:
    """Store what comes from one broker in one database."""

    def __init__(self, broker: Broker, database: str, keeping: Keeping, counts: Counts) -> None:
        self._broker, self._url, self._keeping, self._counts = broker, database, keeping, counts

    async def run(self) -> None:
        """Store until cancelled; raise `BadConnection` for certificates that cannot be used."""
        patience = Patience()
        while True:
            try:
                await self._session(patience)
            except* Trouble as group:
                wait_s = patience.take()
                words = "; ".join(sorted({f"{type(exc).__name__}: {exc}" for exc in _single(group)}))[:300]
                log.warning("broker_or_database_away", error=words, again_in_s=wait_s)
                await asyncio.sleep(wait_s)

    async def _session(self, patience: Patience) -> None:
        """Work while both broker and database are there."""
        connection = await asyncpg.connect(
            self._url, timeout=DATABASE_S, command_timeout=COMMAND_S, server_settings={"tcp_keepalives_idle": "30"}
        )
        try:
            database = Database(connection)
            await database.lock()
            if made := await database.migrate():
                log.info("schema_made", versions=made)
            async with connected(self._broker.client("reprobe-collect")) as client:
                await client.subscribe([(everywhere("records"), 1), (everywhere("state"), 1)])
                # What was on its way to the one before is gone: every station goes on from what is stored.
                await _answer(client, await database.stored())
                log.info("collecting", broker=self._broker.host)
                patience.worked()
                incoming = Incoming()
                async with asyncio.TaskGroup() as tasks:
                    tasks.create_task(keep_rolling(self._url, self._counts.bad_pads))
                    tasks.create_task(_listen(client, incoming))
                    tasks.create_task(self._work(client, database, incoming))
        finally:
            with suppress(*Trouble, TimeoutError):
                await connection.close(timeout=1.0)

    async def _work(self, client: aiomqtt.Client, database: Database, incoming: Incoming) -> None:
        loop = asyncio.get_running_loop()
        house_at_s = 0.0
        while True:
            if loop.time() >= house_at_s:
                gone = await database.keep_house(self._keeping.recent_days, self._keeping.record_months)
                house_at_s = loop.time() + HOUSE_S
                log.info("house_kept", partitions_dropped=gone)
            await incoming.wait(HOUSE_S)
            if not incoming.is_full_group:
                await asyncio.sleep(GROUP_S)
            await self._take(client, database, *incoming.take())

    async def _take(
        self, client: aiomqtt.Client, database: Database, told: Sequence[Arrival], sent: Sequence[Arrival]
    ) -> None:
        states: list[State] = []
        arrived: list[Arrived] = []
        refused: list[Refused] = []
        for topic, payload in (*told, *sent):
            try:
                path = StationPath.of(topic)
                if topic == path.topic("state"):
                    states.append(State(path, *read_state(payload)))
                else:
                    arrived.append(Arrived(path, Batch.of(payload)))
            except (Nonsense, BadName) as exc:
                refused.append(Refused(topic, "", 0, str(exc), payload[:2000].decode(errors="replace")))
        await database.set_states(states)
        if refused:
            await database.refuse(refused)
        answers, more = await self._store(database, arrived)
        for one in (*refused, *more):
            self._counts.refused(one.topic)
            log.error("refused", topic=one.topic, journal=one.journal, seq=one.seq, reason=one.reason)
        await _answer(client, answers)

    async def _store(self, database: Database, arrived: Sequence[Arrived]) -> tuple[list[Answer], list[Refused]]:
        """Store batches together; where the database does not take a value, each row for itself."""
        if not arrived:
            return [], []
        try:
            taken = await database.take(arrived)
        except asyncpg.DataError as exc:
            log.error("a_row_was_not_taken", error=str(exc))
            taken = await database.take(arrived, singly=True)
        self._counts.stored(arrived, taken)
        return taken.answers, taken.refused


def _single(group: BaseExceptionGroup[Exception]) -> Iterator[Exception]:
    """Yield the exceptions of a group and of the groups in it."""
    for exc in group.exceptions:
        if isinstance(exc, BaseExceptionGroup):
            yield from _single(exc)
        else:
            yield exc


async def _listen(client: aiomqtt.Client, incoming: Incoming) -> None:
    async for message in client.messages:
        incoming.put(str(message.topic), _bytes(message.payload))


async def _answer(client: aiomqtt.Client, answers: Sequence[Answer]) -> None:
    """Tell stations how far they are stored; of several words to one, those that send it back and the last."""
    last = {path: number for number, (path, _) in enumerate(answers)}
    for number, (path, stored) in enumerate(answers):
        if stored.resume or last[path] == number:
            # One that goes astray is asked for again, by a batch that comes again.
            await client.publish(path.topic("stored"), stored.to_json(), qos=0, retain=True)


def read_state(payload: bytes) -> tuple[dict[str, Any], str]:
    """Read what a station says of itself, with its JSON; raise `Nonsense` if that is nothing a database takes.

    The broker keeps it and tells it to each new collector: what was taken for good and is not would stop all of them.
    """
    try:
        state = json.loads(payload)
        text = json.dumps(state, allow_nan=False, ensure_ascii=False)
        text.encode()
    except (ValueError, RecursionError) as exc:
        raise Nonsense(f"the state is no JSON: {exc}"[:200]) from exc
    if not isinstance(state, dict) or "\\u0000" in text:
        raise Nonsense("the state is no JSON object of texts")
    alerts = state.get("alerts")
    if alerts is not None and not (isinstance(alerts, list) and all(isinstance(name, str) for name in alerts)):
        raise Nonsense("the state's alerts are no list of names")
    return state, text


def _bytes(payload: object) -> bytes:
    return payload if isinstance(payload, bytes) else str(payload).encode()
