"""Story of a demonstration: each point's record beside what was true of it, and the figures of all in one line."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from daemon.domain.board import Board
from daemon.domain.counted import counted
from daemon.domain.point_test import Cause, PointRecord, PointVerdict, Rung
from daemon.domain.results import JobResult
from daemon.tools.demo.fixture import Fixture
from daemon.tools.demo.true_verdict import first_open, on_net, wrong_verdict
from daemon.tools.demo.truth_log import Stretch, Stroke

UNANSWERED = frozenset({PointVerdict.CONTACT_NOT_MADE, PointVerdict.NOT_TESTED})
BY = {
    Rung.LOOK: "by eye", Rung.PUMP: "by pumping", Rung.REFERENCE: "by brushing the needle",
    Rung.SECOND_SITE: "at a second site",
}  # fmt: skip
"""How people say what cured a false open."""
BY_PRESS = "by a second press"
"""What a look came before, and a film broke at the touch after it: the eye had nothing to correct."""


@dataclass(frozen=True)
class Judged:
    """One point: what the daemon said, and what was true."""

    record: PointRecord
    net: str
    sound: bool
    strokes: tuple[Stroke, ...]

    @property
    def wrong(self) -> str | None:
        """What is wrong with the verdict; None: nothing."""
        if self.record.verdict is PointVerdict.FAIL and self.sound:
            return "fail on a sound net"
        return wrong_verdict(self.record.verdict, self.net, self.strokes, sound=self.sound)

    @property
    def net_or_harness(self) -> bool:
        """Whether the net is broken and contact was proved, but the harness could be to blame as well."""
        undecided = self.record.verdict is PointVerdict.CONTACT_NOT_MADE and not self.sound
        return undecided and sum(bool(reading.proof) for reading in self.record.readings) > 1

    @property
    def answered(self) -> bool:
        """Whether it got an answer: that of a net which no other point speaks for is that nobody knows."""
        return self.record.verdict not in UNANSWERED or self.net_or_harness

    @property
    def false_open(self) -> bool:
        """Whether the net is whole and the first touch did not show it."""
        return self.sound and bool(self.strokes) and self.record.verdict is not PointVerdict.PASS_FIRST

    @property
    def cured(self) -> str:
        """By what a false open was recovered, as people say it."""
        record = self.record
        if record.recovered_by is Rung.LOOK and record.cause is not Cause.MISPLACED:
            return BY_PRESS
        return BY.get(record.recovered_by or Rung.TOUCH, "at the next touch")

    @property
    def truth(self) -> str:
        """What was true of it, in words."""
        net = "net whole" if self.sound else "net broken"
        return ", ".join([net, *(("first touch " + self._first(),) if self.strokes else ())])

    def _first(self) -> str:
        first = self.strokes[0]
        if not on_net(self.net, first):
            met = "/".join(first.nets) or first.material
            off = "" if first.error_um is None else f", {first.error_um:.0f} um from the nearest pad's middle"
            return f"on {met}{off}"
        cause = first_open(self.net, self.strokes, sound=True)
        return "on the pad, through a film" if cause == "soiled" else "on the pad"


@dataclass(frozen=True)
class Story:
    """The whole board."""

    points: tuple[Judged, ...]
    asked: int
    """Points of the plan."""
    scratches: int
    dents: int
    ended: str
    """Outcome of the run's job."""
    why: str = ""
    """Why it ended early; empty where it did not."""
    odd: str = ""
    """What of the log fits no record; empty where all does."""

    @property
    def good(self) -> bool:
        """Whether every point got an answer, each of them is so, and nothing was scratched or dented."""
        answered = [one for one in self.points if one.answered]
        spoiled = self.scratches or self.dents or self.odd or any(one.wrong for one in self.points)
        return not spoiled and self.ended == "run_done" and len(answered) == self.asked

    def sentence(self, speed: float) -> str:
        """Return the figures in one line; `speed`: how many times as fast the station's time runs as the clock."""
        opens = sum(one.false_open for one in self.points)
        cured = [one for one in self.points if one.record.verdict is PointVerdict.PASS_RECOVERED]
        ways = Counter(one.cured for one in cured)
        how = ", ".join(f"{count} {way}" for way, count in ways.most_common())
        confirmed = sum(one.record.verdict is PointVerdict.OPEN_CONFIRMED and not one.sound for one in self.points)
        parts = [
            f"{counted(self.asked, 'net')}: {counted(opens, 'false open')} at first touch",
            f"{len(cured)} recovered" + (f" ({how})" if how else ""),
            f"{counted(confirmed, 'true open')} confirmed",
            f"{sum(one.wrong is not None for one in self.points)} wrong",
            counted(self.scratches, "scratch", "scratches"),
        ]
        either = sum(one.net_or_harness for one in self.points)
        parts += [f"{counted(either, 'open')} in net or harness"] if either else []
        unanswered = self.asked - sum(one.answered for one in self.points)
        parts += [f"{unanswered} without an answer"] if unanswered else []
        parts += [counted(self.dents, "dent")] if self.dents else []
        seconds = [
            one.record.seconds * speed for one in self.points if one.record.verdict is not PointVerdict.NOT_TESTED
        ]
        whose = " by the station's clock" if speed != 1.0 else ""
        parts += [f"{sum(seconds) / len(seconds):.1f} s a point{whose}"] if seconds else []
        return ", ".join(parts)


def judge(
    board: Board, records: Sequence[PointRecord], result: JobResult, asked: int, fixture: Fixture, happened: Stretch
) -> Story:
    """Put the truth beside the records. In the order of the run, each record's touches are the next of the log."""
    touches = _touches(happened.on_board)
    by_name = {point.name: point for point in board.points}
    judged = []
    for record in records:
        own = [next(touches, None) for _ in range(record.touches)]
        for _ in range(record.elsewhere):  # on other points of its net, after its own
            next(touches, None)
        strokes = tuple(stroke for touch in own if touch is not None for stroke in touch)
        point = by_name[record.point]
        sound = fixture.is_sound(point, Stretch(strokes=list(strokes)))
        judged.append(Judged(record, fixture.net_of(point) or "", sound, strokes))
    left, told = sum(1 for _ in touches), sum(record.presses for record in records)
    odd = f"the log has {left} touches more than the records" if left else ""
    if not odd and told != sum(len(one.strokes) for one in judged):
        odd = f"the records tell of {told} presses, the log of {sum(len(one.strokes) for one in judged)}"
    why = result.error.message if result.error is not None else str(result.detail.get("stopped_by", ""))
    return Story(tuple(judged), asked, happened.scratches, happened.dents, result.outcome, why, odd)


def _touches(strokes: Iterable[Stroke]) -> Iterator[list[Stroke]]:
    """Yield the strokes of one descent after the other."""
    touch: list[Stroke] = []
    for stroke in strokes:
        if stroke.first and touch:
            yield touch
            touch = []
        touch.append(stroke)
    if touch:
        yield touch
