"""Database of the fleet in PostgreSQL: its schema brought up to date, and batches stored with how far they are stored.

A group of batches is one transaction: the ledgers of its stations are locked, rows go in by COPY, the ledgers move.
Either all of it is there or nothing is, whatever dies in between.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from importlib.resources import files
from typing import Any, NamedTuple, TypeAlias

import asyncpg
import structlog

from daemon.fleet.batch import Batch, Row, Stored, lost_of
from daemon.fleet.columns import BadRow, Columns, Whole, read_row
from daemon.fleet.ledger import Ledger, decide
from daemon.fleet.partitions import needed, over
from daemon.fleet.topics import StationPath

LOCK_S = 0.5
LOCK = 0x7265_7072_6F62_65
"""Advisory lock of the one collector that works; others wait for it."""
SAID_KEPT = 4000
OPERATOR_DAYS = 90
"""Names of persons are kept so long; then a pseudonym stands in their place."""
Connection: TypeAlias = "asyncpg.Connection[asyncpg.Record]"
log = structlog.get_logger(__name__)


class Arrived(NamedTuple):
    """A batch and where it came from."""

    path: StationPath
    batch: Batch


class Answer(NamedTuple):
    """What a station is told."""

    path: StationPath
    stored: Stored


class State(NamedTuple):
    """How a station says it is, read and as JSON."""

    path: StationPath
    said: dict[str, Any]
    text: str


class Refused(NamedTuple):
    """What cannot be stored, and why."""

    topic: str
    journal: str
    seq: int
    reason: str
    said: str


class Taken(NamedTuple):
    """What came of a group."""

    answers: list[Answer]
    rows: int
    refused: list[Refused]
    lost: list[tuple[StationPath, int]]
    """How many numbers a station could send no longer."""


class _Line(NamedTuple):
    """A row on its way into the tables."""

    at: datetime
    path: StationPath
    journal: str
    station_id: int
    journal_id: int
    seq: int
    whole: Whole


class Database:
    """One connection that stores. Methods raise asyncpg.PostgresError, asyncpg.InterfaceError or OSError."""

    def __init__(self, connection: Connection) -> None:
        self._db = connection
        self._stations: dict[StationPath, int] = {}
        self._partitions: set[str] = set()

    # --- beginning --------------------------------------------------------------------------------------------

    async def lock(self) -> None:
        """Wait until no other collector works on this database."""
        while not await self._db.fetchval("SELECT pg_try_advisory_lock($1)", LOCK):  # noqa: ASYNC110  # it is another computer's
            await asyncio.sleep(LOCK_S)

    async def migrate(self) -> list[int]:
        """Bring the schema up to date; return the versions that were made. The lock must be held."""
        await self._db.execute(
            "CREATE TABLE IF NOT EXISTS migrations (version int PRIMARY KEY, at timestamptz NOT NULL DEFAULT now())"
        )
        done = {row["version"] for row in await self._db.fetch("SELECT version FROM migrations")}
        made: list[int] = []
        for version, sql in _migrations():
            if version not in done:
                async with self._db.transaction():
                    await self._db.execute(sql)
                    await self._db.execute("INSERT INTO migrations(version) VALUES ($1)", version)
                made.append(version)
        return made

    async def stored(self) -> list[Answer]:
        """Return how far each station is stored."""
        rows = await self._db.fetch(
            "SELECT DISTINCT ON (s.id) s.site, s.line, s.name, j.journal, j.stored_seq FROM stations s"
            " JOIN journals j ON j.station = s.id ORDER BY s.id, j.id DESC"
        )
        return [
            Answer(
                StationPath(row["site"], row["line"], row["name"]),
                Stored(row["journal"], row["stored_seq"], resume=True),
            )
            for row in rows
        ]

    # --- storing ----------------------------------------------------------------------------------------------

    async def take(self, group: Sequence[Arrived], now: datetime | None = None, *, singly: bool = False) -> Taken:
        """Store a group of batches in one transaction, each row once.

        `singly`: row by row, so that one which the database does not take keeps no other back.
        """
        at = now or datetime.now(UTC)
        async with self._db.transaction():
            await self._make_partitions(at)
            ids = await self._ids({arrived.path for arrived in group})
            taken = await self._take(group, ids, at, singly=singly)
        self._stations.update(ids)
        self._partitions = {partition.name for partition in needed(at)}
        return taken

    async def _take(
        self, group: Sequence[Arrived], ids: dict[StationPath, int], at: datetime, *, singly: bool
    ) -> Taken:
        ledgers = await self._ledgers(ids)
        taken = Taken([], 0, [], [])
        ends: dict[tuple[int, str], int] = {}
        read: list[tuple[StationPath, str, int, Whole]] = []
        for path, batch in group:
            decision = decide(batch, ledgers[path])
            if decision.refusal:
                taken.refused.append(Refused(path.topic("records"), batch.journal, batch.last, decision.refusal, ""))
            if decision.rows:
                ends[ids[path], batch.journal] = batch.last
                good, bad = _read(path, batch.journal, decision.rows)
                read += [(path, batch.journal, seq, whole) for seq, whole in good]
                taken.refused.extend(bad)
                taken.lost.extend((path, last - first + 1) for first, last in filter(None, map(lost_of, decision.rows)))
            if decision.answer is not None:
                taken.answers.append(Answer(path, decision.answer))
        journals = await self._move(ends)
        lines = [
            _Line(at, path, journal, ids[path], journals[ids[path], journal], seq, whole)
            for path, journal, seq, whole in read
        ]
        if singly:
            taken.refused.extend([refused for line in lines for refused in await self._try(line)])
        else:
            await self._copy(lines)
        await self._refuse(taken.refused)
        return taken._replace(rows=len(lines))

    async def _copy(self, lines: Sequence[_Line]) -> None:
        records = [(n.at, n.station_id, n.journal_id, n.seq, *n.whole.columns) for n in lines]
        recent = [(n.at, n.journal_id, n.seq, n.whole.body, n.whole.circumstances) for n in lines]
        await self._db.copy_records_to_table("records", records=records, columns=(*_KEYS, *Columns._fields))
        await self._db.copy_records_to_table("recent", records=recent, columns=_RECENT)

    async def _try(self, line: _Line) -> list[Refused]:
        """Store one row; return it with the database's reason where that does not take it."""
        try:
            async with self._db.transaction():
                await self._copy([line])
        except asyncpg.DataError as exc:
            return [Refused(line.path.topic("records"), line.journal, line.seq, str(exc)[:200], repr(line.whole))]
        return []

    async def refuse(self, refused: Iterable[Refused]) -> None:
        """Write down what nobody can read."""
        async with self._db.transaction():
            await self._refuse(refused)

    async def _refuse(self, refused: Iterable[Refused]) -> None:
        await self._db.executemany(
            "INSERT INTO refused(topic, journal, seq, reason, said) VALUES ($1, $2, $3, $4, $5)"
            " ON CONFLICT (topic, journal, seq, reason) DO UPDATE SET times = refused.times + 1, last_at = now()",
            [(r.topic, r.journal, r.seq, plain_text(r.reason), plain_text(r.said)) for r in refused],
        )

    async def set_states(self, states: Sequence[State]) -> None:
        """Write down how stations say they are."""
        if not states:
            return
        self._stations.update(await self._ids({state.path for state in states}))
        await self._db.executemany(
            "INSERT INTO states VALUES ($1, now(), $2, $3, $4, $5, $6, $7) ON CONFLICT (station) DO UPDATE SET"
            " at = now(), online = excluded.online, state = excluded.state, fault = excluded.fault,"
            " program = excluded.program, alerts = excluded.alerts, body = excluded.body",
            [
                (self._stations[path], bool(said.get("online")), _said(said, "state"), _said(said, "fault"),
                 _said(said, "program"), said.get("alerts") or [], text) for path, said, text in states
            ],
        )  # fmt: skip

    async def _ids(self, paths: set[StationPath]) -> dict[StationPath, int]:
        """Return the numbers of stations; who is not known yet gets one."""
        ids = {path: self._stations[path] for path in paths & self._stations.keys()}
        if unknown := sorted(paths - ids.keys()):
            ids |= await self._find(unknown)
        if new := sorted(paths - ids.keys()):
            await self._db.execute(
                "INSERT INTO stations(site, line, name) SELECT * FROM unnest($1::text[], $2::text[], $3::text[])",
                *_columns(new),
            )
            ids |= await self._find(new)
        return ids

    async def _find(self, paths: Sequence[StationPath]) -> dict[StationPath, int]:
        sql = (
            "SELECT id, site, line, name FROM stations"
            " WHERE (site, line, name) IN (SELECT * FROM unnest($1::text[], $2::text[], $3::text[]))"
        )
        rows = await self._db.fetch(sql, *_columns(paths))
        return {StationPath(row["site"], row["line"], row["name"]): row["id"] for row in rows}

    async def _ledgers(self, ids: Mapping[StationPath, int]) -> dict[StationPath, Ledger]:
        """Return what is stored of stations, by one question: there may be hundreds of them in a group."""
        cursors: dict[int, dict[str, int]] = {station: {} for station in ids.values()}
        sql = "SELECT station, journal, stored_seq FROM journals WHERE station = ANY($1) ORDER BY id FOR UPDATE"
        for row in await self._db.fetch(sql, list(cursors)):
            cursors[row["station"]][row["journal"]] = row["stored_seq"]
        return {path: Ledger(cursors[station]) for path, station in ids.items()}

    async def _move(self, ends: Mapping[tuple[int, str], int]) -> dict[tuple[int, str], int]:
        """Write down how far journals of stations are stored, new ones in their order; return their ids."""
        sql = (
            "INSERT INTO journals(station, journal, stored_seq)"
            " SELECT * FROM unnest($1::int[], $2::text[], $3::bigint[])"
            " ON CONFLICT (station, journal) DO UPDATE SET stored_seq = excluded.stored_seq"
            " RETURNING station, journal, id"
        )
        stations, journals = [station for station, _ in ends], [journal for _, journal in ends]
        rows = await self._db.fetch(sql, stations, journals, list(ends.values()))
        return {(row["station"], row["journal"]): row["id"] for row in rows}

    # --- partitions -------------------------------------------------------------------------------------------

    async def _make_partitions(self, at: datetime) -> None:
        for partition in needed(at):
            if partition.name not in self._partitions:
                await self._db.execute(partition.sql)

    async def keep_house(self, recent_days: int, record_months: int | None, now: datetime | None = None) -> list[str]:
        """Drop what is kept no longer, and put pseudonyms for persons' names; return which partitions went."""
        at = now or datetime.now(UTC)
        found = await self._db.fetch(
            "SELECT c.relname FROM pg_inherits i JOIN pg_class c ON c.oid = i.inhrelid JOIN pg_class p"
            " ON p.oid = i.inhparent WHERE p.relname IN ('records', 'recent')"
        )
        gone = over([row["relname"] for row in found], at, recent_days, record_months)
        for name in gone:
            await self._db.execute(f'DROP TABLE "{name}"')
        self._partitions -= set(gone)
        await self._db.execute(
            "UPDATE records SET body = jsonb_set(body, '{by}', to_jsonb('person-' || left(md5(body ->> 'by'"
            " || (SELECT system_identifier FROM pg_control_system())), 8))) WHERE kind = 'order'"
            " AND received_at < $1::timestamptz - make_interval(days => $2) AND body ->> 'by' NOT LIKE 'person-%'",
            at, OPERATOR_DAYS,
        )  # fmt: skip
        return gone


_KEYS = ("received_at", "station", "journal", "seq")
_RECENT = ("received_at", "journal", "seq", "body", "circumstances")


def _read(path: StationPath, journal: str, rows: Iterable[Row]) -> tuple[list[tuple[int, Whole]], list[Refused]]:
    """Return rows that can be stored, by number, and those that nobody can read."""
    good: list[tuple[int, Whole]] = []
    bad: list[Refused] = []
    for row in rows:
        try:
            good.append((int(row["seq"]), read_row(row)))
        except BadRow as exc:
            bad.append(Refused(path.topic("records"), journal, int(row["seq"]), str(exc), repr(row)))
    return good, bad


def _migrations() -> list[tuple[int, str]]:
    """Return version and SQL of each, in their order."""
    folder = files("daemon.fleet") / "schema"
    found = [(int(file.name[:3]), file.read_text()) for file in folder.iterdir() if file.name.endswith(".sql")]
    return sorted(found)


def _columns(paths: Sequence[StationPath]) -> list[list[str]]:
    """Return sites, lines and names."""
    return [[path.site for path in paths], [path.line for path in paths], [path.station for path in paths]]


def _said(state: dict[str, Any], name: str) -> str | None:
    value = state.get(name)
    return value[:200] if isinstance(value, str) else None


def plain_text(text: str) -> str:
    """Return a text as a database takes it."""
    return text[:SAID_KEPT].replace("\0", "\\0").encode(errors="backslashreplace").decode()
