"""Nonsense on the broker, and two uplinks of one name: each is said, nothing is lost, and nothing comes down."""

from __future__ import annotations

import asyncio
import sqlite3
import time
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path

import aiomqtt
import pytest

from daemon.fleet.batch import Stored
from tests.bench.fleet import STATIONS, STORED, Plant, Process, ask, plant, uplink_arguments
from tests.fleet.journal_server import fill

pytestmark = pytest.mark.timeout(240)
TOPIC = "reprobe/v1/north/L1/station-1"
COMMAND = b'{"v": 1, "op": "home", "id": "from above"}'
NONSENSE = (b"", b"{", b'{"v": 1, "journal": 5, "seq": 1}', b'{"v": 9}', COMMAND, b"\xff\xfe")


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Plant]:
    with plant(tmp_path, dict.fromkeys(STATIONS, 300)) as found:
        yield found


def _publish(running: Plant, topic: str, *payloads: bytes, retain: bool = False) -> None:
    async def publish() -> None:
        async with aiomqtt.Client("127.0.0.1", running.broker.port) as client:
            for payload in payloads:
                await client.publish(topic, payload, qos=1, retain=retain)

    asyncio.run(publish())


def _wait_for(running: Plant, sql: str, expected: Sequence[tuple[object, ...]]) -> None:
    while ask(running.database, sql) != list(expected):  # the test's own timeout ends it
        time.sleep(0.2)


def _wait_for_words(log: Path, words: str) -> None:
    while words not in log.read_text():
        time.sleep(0.2)


ALL = [(600, 600, 600)]


def test_a_centre_that_answers_nonsense_is_not_believed_and_all_arrives(running: Plant, tmp_path: Path) -> None:
    _publish(running, f"{TOPIC}/stored", *NONSENSE, retain=True)
    _wait_for(running, STORED, ALL)
    _publish(running, f"{TOPIC}/stored", *NONSENSE)
    _wait_for_words(tmp_path / "uplink-station-1.log", "centre_says_nonsense")
    _wait_for(running, STORED, ALL)
    # It knows no operation but those that observe: another one would have ended it.
    assert not running.stations[0].is_over


def test_a_centre_that_says_of_everything_that_it_is_not_stored_gets_it_again_and_nothing_is_stored_twice(
    running: Plant, tmp_path: Path
) -> None:
    _wait_for(running, STORED, ALL)
    nothing, beyond = Stored(None, 0, resume=True), Stored(_journal(tmp_path / "station-1.sqlite"), 9000)
    _publish(running, f"{TOPIC}/stored", *[nothing.to_json()] * 100)
    while "was never written" not in (tmp_path / "uplink-station-1.log").read_text():
        _publish(running, f"{TOPIC}/stored", beyond.to_json())  # the true word may come between, so again
        time.sleep(0.2)
    running.stations[1].stop()
    asyncio.run(fill(tmp_path / "station-2.sqlite", "more", 10))
    running.stations[1].start()
    _wait_for(running, STORED, [(610, 610, 610)])
    assert ask(running.database, "SELECT count(*) FROM refused") == [(0,)]


def _journal(file: Path) -> str:
    """Return the id of the journal that is written now."""
    with closing(sqlite3.connect(file)) as db:
        ((found,),) = db.execute("SELECT id FROM journals ORDER BY n DESC LIMIT 1").fetchall()
    return str(found)


def test_nonsense_from_a_station_is_kept_apart_and_the_others_go_on(running: Plant) -> None:
    _wait_for(running, "SELECT count(*) FROM stations", [(2,)])
    _publish(running, f"{TOPIC}/records", *NONSENSE)
    _publish(running, f"{TOPIC}/state", b"[]", b'{"online": "\\u0000"}')
    _publish(running, "reprobe/v1/north/ /x/records", b"{}")
    _wait_for(running, STORED, ALL)
    _wait_for(running, "SELECT count(DISTINCT topic) FROM refused", [(3,)])


def test_two_uplinks_of_one_name_are_told_by_the_one_that_is_put_out(running: Plant, tmp_path: Path) -> None:
    _wait_for(running, STORED, ALL)
    arguments = uplink_arguments(tmp_path, "station-1", running.broker)
    other = Process(tmp_path / "other.log", "-m", "daemon.fleet", arguments)
    try:
        _wait_for_words(tmp_path / "uplink-station-1.log", "another_uplink")
        _wait_for(running, STORED, ALL)
    finally:
        other.stop()
