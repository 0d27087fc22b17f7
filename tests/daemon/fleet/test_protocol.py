"""Whatever a broker drops, repeats and reorders, and whatever dies: each record is stored once, none is passed over."""

from __future__ import annotations

import random
from dataclasses import dataclass, field
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.fleet.batch import Batch, Nonsense, Row, Stored, batch_of, lost_of, lost_row, without_holes
from daemon.fleet.ledger import ANOTHER, Ledger, decide
from daemon.fleet.send_window import STALL_S, Position, SendWindow


@dataclass
class Station:
    """What the daemon keeps, as `records` tells it: journals of numbers that go on, the oldest ones trimmed away."""

    journals: list[tuple[str, int, int]] = field(default_factory=list)
    """Id, first and last number of each."""
    oldest: int = 1

    def write(self, journal: str, count: int) -> None:
        following = self.journals[-1][2] + 1 if self.journals else 1
        self.journals.append((journal, following, following + count - 1))

    def put_back(self, journal: str, last: int) -> None:
        """Restore a backup made when `last` was the newest number; what follows is of another journal."""
        self.journals = [(name, first, min(end, last)) for name, first, end in self.journals if first <= last]
        self.write(journal, 0)

    def page(self, position: Position, limit: int) -> dict[str, Any]:
        since = position.since
        names = [name for name, _, _ in self.journals]
        if position.journal is not None and position.journal not in names:
            since = 1
        elif position.journal is not None:
            since = min(since, self.journals[names.index(position.journal)][2] + 1)
        since = max(since, self.journals[0][1])
        (name, first, end) = next((one for one in self.journals if one[1] <= since <= one[2]), self.journals[-1])
        begin = max(since, first)
        before = next(((n, first - 1) for n, f, e in reversed(self.journals) if e >= f and e == first - 1), None)
        lost = (begin, min(self.oldest - 1, end)) if begin < min(self.oldest, end + 1) else None
        return {
            "journal": name, "first_seq": first, "next_seq": self.journals[-1][2] + 1,
            "previous": None if before is None else {"journal": before[0], "seq": before[1]},
            "lost": None if lost is None else {"from_seq": lost[0], "to_seq": lost[1]},
            "records": [_row(name, seq) for seq in range(max(begin, self.oldest), end + 1)][:limit],
        }  # fmt: skip


def _row(journal: str, seq: int) -> Row:
    return {"seq": seq, "kind": "report", "at": None, "body": {"of": journal, "n": seq}, "circumstances": {}}


@dataclass
class Centre:
    """Rows and cursor, in one transaction."""

    ledger: Ledger = field(default_factory=Ledger)
    rows: list[tuple[str, int]] = field(default_factory=list)
    lost: set[tuple[str, int]] = field(default_factory=set)
    refused: list[str] = field(default_factory=list)

    def take(self, payload: bytes) -> Stored | None:
        batch = Batch.of(payload)
        decision = decide(batch, self.ledger)
        for row in decision.rows:
            if gone := lost_of(row):
                self.lost |= {(batch.journal, seq) for seq in range(gone[0], gone[1] + 1)}
            else:
                self.rows.append((batch.journal, row["seq"]))
        if decision.refusal:
            self.refused.append(decision.refusal)
        return decision.answer


class Pipe:
    """Two directions of messages, handed on in an order and number of times that chance decides."""

    def __init__(self, chance: random.Random, trouble: float) -> None:
        self.chance, self.trouble = chance, trouble
        self.up: list[bytes] = []
        self.down: list[bytes] = []

    def through(self, queue: list[bytes]) -> list[bytes]:
        """Take what is in a queue out of it; some of it is lost, or comes twice, or late."""
        out: list[bytes] = []
        for message in queue:
            draw = self.chance.random()
            if draw < self.trouble:
                continue
            out += [message] * (2 if draw < 2 * self.trouble else 1)
        if self.chance.random() < self.trouble:
            self.chance.shuffle(out)
        kept = out[len(out) // 2 :] if self.chance.random() < self.trouble else []
        queue[:] = kept
        return out[: len(out) - len(kept)]


def _run(station: Station, centre: Centre, pipe: Pipe, rounds: int, limit: int = 10) -> SendWindow:
    """Let uplink and collector work; the uplink is killed now and then, and knows nothing afterwards."""
    window, now_s = SendWindow(), 0.0
    for _ in range(rounds):
        now_s += 0.5
        if pipe.chance.random() < pipe.trouble / 2:
            window = SendWindow()
        if window.is_stalled(now_s):
            window.retry()
        while window.has_room:
            asked = window.position
            batch = batch_of(station.page(asked, limit), *asked)
            if batch is None or not window.may_send(batch):
                break
            pipe.up.append(batch.to_json())
            window.sent(batch, now_s)
        for payload in pipe.through(pipe.up):
            if (answer := centre.take(payload)) is not None:
                pipe.down.append(answer.to_json())
        for payload in pipe.through(pipe.down):
            window.heard(Stored.of(payload), now_s)
    return window


def _rows(station: Station) -> list[tuple[str, int]]:
    return [(name, seq) for name, first, end in station.journals for seq in range(first, end + 1)]


@settings(max_examples=150, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    trouble=st.floats(0.0, 0.3),
    counts=st.lists(st.integers(0, 60), min_size=1, max_size=5),
)
def test_each_record_is_stored_once_over_any_broker(seed: int, trouble: float, counts: list[int]) -> None:
    station, centre = Station(), Centre()
    pipe = Pipe(random.Random(seed), trouble)
    for number, count in enumerate(counts):
        station.write(f"J{number}", count)
        _run(station, centre, pipe, rounds=5)
    pipe.trouble = 0.0
    _run(station, centre, pipe, rounds=300)
    assert centre.rows == _rows(station)
    assert not centre.lost
    assert not centre.refused


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10_000), kept=st.integers(0, 59), after=st.integers(1, 40))
def test_a_station_put_back_from_a_backup_is_stored_on_and_what_was_stored_stays(
    seed: int, kept: int, after: int
) -> None:
    station, centre = Station(), Centre()
    pipe = Pipe(random.Random(seed), 0.1)
    station.write("J0", 30)
    station.write("J1", 30)
    _run(station, centre, pipe, rounds=200)
    before = list(centre.rows)
    station.put_back("J2", kept)
    name, first, _ = station.journals[-1]
    station.journals[-1] = (name, first, first + after - 1)
    pipe.trouble = 0.0
    _run(station, centre, pipe, rounds=200)
    assert centre.rows == before + [("J2", seq) for seq in range(kept + 1, kept + after + 1)]
    assert not centre.refused


def test_a_fresh_journal_under_the_old_name_is_stored_from_its_beginning() -> None:
    station, centre, pipe = Station(), Centre(), Pipe(random.Random(1), 0.0)
    station.write("old", 100)
    _run(station, centre, pipe, rounds=50)
    fresh = Station()
    fresh.write("new", 100)
    _run(fresh, centre, pipe, rounds=50)
    assert centre.rows == _rows(station) + _rows(fresh)


def test_what_was_trimmed_before_it_was_sent_is_stored_as_lost() -> None:
    station, centre, pipe = Station(), Centre(), Pipe(random.Random(1), 0.0)
    station.write("J0", 20)
    station.write("J1", 20)
    station.oldest = 26
    _run(station, centre, pipe, rounds=50)
    assert centre.rows == [("J1", seq) for seq in range(26, 41)]
    assert centre.lost == {row for row in _rows(station) if row[1] < 26}


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10_000), backup=st.integers(0, 3))
def test_a_database_put_back_from_a_backup_is_filled_up_again(seed: int, backup: int) -> None:
    """It may know none, some or all of the journals."""
    station, centre, pipe = Station(), Centre(), Pipe(random.Random(seed), 0.1)
    for number in range(4):
        station.write(f"J{number}", 25)
        if number < backup:
            _run(station, centre, pipe, rounds=200)
    copy = Centre(Ledger(dict(centre.ledger.cursors)), list(centre.rows))
    _run(station, centre, pipe, rounds=200)
    pipe.trouble = 0.0
    window = _run(station, copy, pipe, rounds=300)
    assert copy.rows == _rows(station)
    assert window.is_empty


def test_two_stations_of_one_name_are_found_out_and_rows_of_one_are_refused() -> None:
    centre = Centre()
    one, two = Station(), Station()
    one.write("A", 10)
    two.write("B", 10)
    for station in (one, two):
        _run(station, centre, Pipe(random.Random(1), 0.0), rounds=20)
    one.journals = [("A", 1, 20)]
    batch = batch_of(one.page(Position("A", 11), 100), "A", 11)
    assert batch is not None
    assert centre.take(batch.to_json()) is None
    assert centre.refused == [ANOTHER]
    assert len(centre.rows) == 20


def test_the_window_sends_one_batch_until_the_centre_answers_and_again_when_it_is_silent() -> None:
    window, station = SendWindow(), Station()
    station.write("J", 100)
    first = batch_of(station.page(window.position, 10), *window.position)
    assert first is not None
    window.sent(first, 10.0)
    assert not window.has_room
    assert not window.is_stalled(10.0 + STALL_S / 2)
    assert window.is_stalled(10.0 + STALL_S)
    window.retry()
    assert window.position == Position(None, 1)
    window.heard(Stored("J", 10), 13.0)
    assert (window.position, window.has_room) == (Position("J", 11), True)


def test_a_centre_that_says_nothing_is_sent_to_less_and_less_often_and_as_often_as_before_once_it_speaks() -> None:
    window, batch = SendWindow(), Batch("J", 1, None, 0, [_row("J", 1)])
    now_s, waits = 0.0, []
    for _ in range(7):
        window.sent(batch, now_s)
        wait_s = next(s for s in range(1, 100) if window.is_stalled(now_s + s))
        waits.append(wait_s)
        now_s += wait_s
        window.retry()
    assert waits == [2, 4, 8, 16, 32, 32, 32]
    window.heard(Stored(None, 0, resume=True), now_s)
    window.sent(batch, now_s)
    assert window.is_stalled(now_s + STALL_S)


def test_a_word_about_less_than_is_stored_sends_the_uplink_back() -> None:
    window = SendWindow()
    window.heard(Stored("J", 500), 0.0)
    window.heard(Stored("J", 300), 1.0)
    assert window.position == Position("J", 301)


@pytest.mark.parametrize(
    "payload",
    [
        b"", b"[]", b"{", b"\xff", b"null", b'{"v":1}', b'{"v":2,"journal":"J","seq":1}',
        b'{"v":1,"journal":7,"seq":1}',
        b'{"v":1,"journal":"J","seq":-1}', b'{"v":1,"journal":"J","seq":true}', b'{"v":1,"journal":"J","seq":1e3}',
        b'{"v":1,"journal":"J","seq":99999999999999999999}', b'{"v":1,"journal":"","seq":1}', b"[" * 100_000,
        b'{"v":1,"journal":"a\\u0000b","seq":1}', b'{"v":1,"journal":"' + b"x" * 65 + b'","seq":1}',
    ],
)  # fmt: skip
def test_nonsense_from_either_side_is_called_so(payload: bytes) -> None:
    for read in (Stored.of, Batch.of):
        with pytest.raises(Nonsense):
            read(payload)


def _batch(after: int, *rows: object, first_seq: int = 1) -> bytes:
    return Batch("J", first_seq, None, after, list(rows)).to_json()  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "payload",
    [
        _batch(0), _batch(0, _row("J", 2)), _batch(0, _row("J", 1), _row("J", 1)), _batch(0, "row"), _batch(0, {}),
        _batch(3, _row("J", 4), first_seq=9), _batch(0, lost_row(2, 5)), _batch(0, lost_row(1, 5) | {"seq": 6}),
        _batch(0, lost_row(1, 5) | {"kind": "report"}), _batch(0, *(_row("J", seq) for seq in range(1, 502))),
    ],
)  # fmt: skip
def test_a_batch_with_a_gap_that_nothing_explains_is_refused(payload: bytes) -> None:
    with pytest.raises(Nonsense):
        Batch.of(payload)


def test_numbers_that_are_missing_in_the_middle_are_told_as_lost() -> None:
    rows = list(without_holes(2, [_row("J", 2), _row("J", 3), _row("J", 7)]))
    assert rows == [_row("J", 3), lost_row(4, 6), _row("J", 7)]
    assert Batch.of(Batch("J", 1, None, 2, rows).to_json()).rows == rows


def test_rows_that_are_gone_or_cannot_be_read_are_told_as_lost_and_not_stored_empty() -> None:
    rows = [_row("J", seq) | ({"body": None, "at": None} if seq in {1, 2, 4, 6, 7} else {}) for seq in range(1, 8)]
    told = [lost_row(1, 2), _row("J", 3), lost_row(4, 4), _row("J", 5), lost_row(6, 7)]
    assert list(without_holes(0, rows)) == told
    assert list(without_holes(1, rows[:2])) == [lost_row(2, 2)]
    assert Batch.of(Batch("J", 1, None, 0, told).to_json()).rows == told
