"""Rollups: hours of the fleet's records counted into tables that questions over years read. The SQL is `roll_up`'s.

It works beside the storing, by a connection of its own: nothing that is on its way waits for it.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import asyncpg
import structlog

from daemon.fleet.database import Connection

ROLL_S = 10.0
"""So old may a count be, where counting is quick."""
SHARE = 0.05
"""Of the time at most is spent on counting: a large fleet's hours are counted less often."""
log = structlog.get_logger(__name__)


async def roll_up(connection: Connection) -> int:
    """Count what is new; return how many hours of stations were counted again."""
    async with connection.transaction(isolation="repeatable_read"):
        return int(await connection.fetchval("SELECT roll_up()", timeout=None))


async def bad_pads(connection: Connection) -> dict[str, int]:
    """Return how many pads of each board design miss at many stations; of every design that was ever tested."""
    sql = (
        "SELECT coalesce(d.board, '') AS board, (SELECT count(*) FROM bad_pads b WHERE b.board IS NOT DISTINCT FROM"
        " d.board) AS pads FROM (SELECT DISTINCT board FROM points_by_hour) AS d"
    )
    return {row["board"]: int(row["pads"]) for row in await connection.fetch(sql)}


async def keep_rolling(url: str, tell: Callable[[dict[str, int]], None]) -> None:
    """Count until cancelled; raise what asyncpg raises where the database is away. `tell`: is given `bad_pads`."""
    connection = await asyncpg.connect(url, timeout=5.0, server_settings={"tcp_keepalives_idle": "30"})
    loop = asyncio.get_running_loop()
    begun = False
    try:
        while True:
            begun_s = loop.time()
            try:
                if await roll_up(connection) or not begun:
                    tell(await bad_pads(connection))
                begun = True
            except asyncpg.PostgresError as exc:
                if connection.is_closed():
                    raise
                log.error("not_rolled_up", error=str(exc))  # records go on being stored
            took_s = loop.time() - begun_s
            await asyncio.sleep(max(ROLL_S, took_s / SHARE))
    finally:
        connection.terminate()
