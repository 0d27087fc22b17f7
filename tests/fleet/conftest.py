"""Real engines, started by `make test-fleet` alone: it needs Debian's mosquitto and postgresql."""

from __future__ import annotations

import os
from collections.abc import AsyncIterator, Iterator
from itertools import count
from pathlib import Path

import asyncpg
import pytest

from daemon.fleet.database import Connection, Database
from tests.fleet.engines import PostgreSQL, missing
from tests.packages import not_installed

WANTED = bool(os.environ.get("REPROBE_TEST_FLEET"))
_NUMBERS = count(1)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip where nobody asked for engines; asked for and not there is a failure."""
    for item in items:
        if Path(item.path).parent == Path(__file__).parent and not WANTED:
            item.add_marker(pytest.mark.skip(reason="`make test-fleet` runs it: it needs Mosquitto and PostgreSQL"))


@pytest.fixture(scope="session")
def cluster() -> Iterator[PostgreSQL]:
    assert not missing(), not_installed(*missing())
    found = PostgreSQL()
    found.start()
    yield found
    found.remove()


@pytest.fixture
async def database_url(cluster: PostgreSQL) -> str:
    """Where a database of the test's own is."""
    name = f"fleet{os.getpid()}_{next(_NUMBERS)}"
    maker = await asyncpg.connect(cluster.url)
    await maker.execute(f"CREATE DATABASE {name}")
    await maker.close()
    return cluster.url.replace("/postgres", f"/{name}")


@pytest.fixture
async def connection(database_url: str) -> AsyncIterator[Connection]:
    """A connection to it."""
    found = await asyncpg.connect(database_url)
    yield found
    await found.close()


@pytest.fixture
async def database(connection: Connection) -> Database:
    made = Database(connection)
    await made.lock()
    await made.migrate()
    return made
