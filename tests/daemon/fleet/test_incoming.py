"""States go before records, stations take turns, and what has no room is left out without a hole."""

from __future__ import annotations

import asyncio

from daemon.fleet.incoming import GROUP, GROUP_BYTES, WAITING_BYTES, Arrival, Incoming
from daemon.fleet.send_window import BATCHES_OUT


def _of(topic: str, *payloads: bytes) -> list[Arrival]:
    return [Arrival(topic, payload) for payload in payloads]


def test_of_the_states_of_a_station_the_newest_is_taken_whatever_else_waits() -> None:
    incoming = Incoming()
    for n in range(2 * GROUP):
        incoming.put(f"{n}/records", b"batch")
    incoming.put("a/state", b"old")
    incoming.put("b/state", b"of b")
    incoming.put("a/state", b"new")
    states, batches = incoming.take()
    assert states == [*_of("a/state", b"new"), *_of("b/state", b"of b")]
    assert len(batches) == GROUP
    assert incoming.take()[0] == []


def test_stations_take_turns_and_the_batches_of_one_stay_in_their_order() -> None:
    incoming = Incoming()
    for payload in (b"1", b"2", b"3"):
        incoming.put("a", payload)
    incoming.put("b", b"first")
    assert incoming.take()[1] == [*_of("a", b"1"), *_of("b", b"first"), *_of("a", b"2", b"3")]


def test_a_group_is_small_but_one_batch_is_always_taken() -> None:
    incoming = Incoming()
    large = bytes(GROUP_BYTES)
    for topic in ("a", "b"):
        incoming.put(topic, large)
        incoming.put(topic, b"small")
    assert incoming.is_full_group
    assert incoming.take()[1] == _of("a", large)
    assert incoming.take()[1] == _of("b", large)
    assert not incoming.is_full_group
    assert incoming.take()[1] == [*_of("a", b"small"), *_of("b", b"small")]


def test_what_comes_again_or_beyond_what_an_uplink_sends_is_left_out() -> None:
    incoming = Incoming()
    for n in range(BATCHES_OUT + 3):
        incoming.put("a", b"%d" % n)
        incoming.put("a", b"%d" % n)
    assert incoming.take()[1] == _of("a", *(b"%d" % n for n in range(BATCHES_OUT)))


def test_what_waits_has_a_bound_and_what_was_taken_makes_room() -> None:
    incoming = Incoming()
    half = bytes(WAITING_BYTES // 2)
    for topic in ("a", "b", "c"):
        incoming.put(topic, half)
    assert [incoming.take()[1], incoming.take()[1], incoming.take()[1]] == [_of("a", half), _of("b", half), []]
    incoming.put("c", half)
    assert incoming.take()[1] == _of("c", half)


async def test_who_waits_goes_on_as_something_comes_and_waits_again_once_all_is_taken() -> None:
    incoming = Incoming()
    waiting = asyncio.ensure_future(incoming.wait(3600.0))
    await asyncio.sleep(0)
    assert not waiting.done()
    incoming.put("a/state", b"{}")
    await waiting
    incoming.put("a", b"1")
    incoming.take()
    again = asyncio.ensure_future(incoming.wait(3600.0))
    await asyncio.sleep(0)
    assert not again.done()
    again.cancel()
