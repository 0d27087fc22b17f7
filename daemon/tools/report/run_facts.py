"""Facts of a board's run for its report: each test with its record, in the plan's order, in words and numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from daemon.config.plan_units import with_unit
from daemon.domain.board_run import BoardRun, RunPlace, RunSummary, summarise
from daemon.domain.point_test import Limits, PointRecord, PointTest, PointVerdict
from daemon.storage.journal_reader import JournalReader

PICTURES = ("*.jpg", "*.png")
TELLING = ("-landing", "-board", "-tip", "-pads")
"""Ends of the names of pictures in which something is drawn; those without are shown only where there is none."""

LOOK_WORDS = {"before": "first look", "after": "last look"}
KIND_WORDS = {
    "landing": "where the needle came down", "board": "the board's data over the picture", "tip": "the tip as found",
    "pads": "the pads as found", "cross": "the control point as found", "white": "white light", "red": "red light",
}  # fmt: skip
"""What a picture shows, by the two parts of its name (`daemon.jobs.image_archive`)."""


@dataclass(frozen=True)
class VerdictStyle:
    """How a verdict is told: a letter for those who see no colours, a style class, and words."""

    letter: str
    name: str
    words: str


STYLES: Final[Mapping[PointVerdict | None, VerdictStyle]] = {
    PointVerdict.PASS_FIRST: VerdictStyle("P", "first", "passed at the first touch"),
    PointVerdict.PASS_RECOVERED: VerdictStyle("R", "recovered", "a false open, recovered"),
    PointVerdict.FAIL: VerdictStyle("F", "fail", "contact proved, outside its limits"),
    PointVerdict.OPEN_CONFIRMED: VerdictStyle("O", "open", "open, with contact proved"),
    PointVerdict.CONTACT_NOT_MADE: VerdictStyle("C", "contact", "no contact could be proved"),
    PointVerdict.NOT_TESTED: VerdictStyle("N", "none", "not tested"),
    None: VerdictStyle("-", "left", "not reached yet"),
}
"""By verdict; None: the run has not come to it."""


@dataclass(frozen=True)
class Tested:
    """One test of a run and what came of it; without a record the run has not come to it."""

    number: int
    test: PointTest
    place: RunPlace
    record: PointRecord | None
    pictures: tuple[Path, ...] = ()
    """Files beside the page, as it links them."""

    @property
    def style(self) -> VerdictStyle:
        """How its verdict is told."""
        return STYLES[self.record.verdict if self.record else None]

    @property
    def limits(self) -> str:
        """Its limits in words."""
        return limits_in_words(self.record.limits if self.record else self.test.limits)

    @property
    def first(self) -> str:
        """What was read at the first touch."""
        return self._reading(0)

    @property
    def last(self) -> str:
        """What was read at the last press."""
        return self._reading(-1)

    def _reading(self, at: int) -> str:
        readings = self.record.readings if self.record else ()
        if not readings:
            return ""
        return "open" if readings[at].overload else with_unit(readings[at].value, readings[at].unit)

    @property
    def why(self) -> str:
        """Why it is as it is, in words."""
        if self.record is None:
            return ""
        if self.record.verdict is PointVerdict.PASS_RECOVERED:
            by = f"by {self.record.recovered_by.replace('_', ' ')}" if self.record.recovered_by else ""
            cause = f"{self.record.cause}" if self.record.cause else ""
            return ", ".join(filter(None, (by, cause, self.record.reason)))
        return self.record.reason


@dataclass(frozen=True)
class RunReport:
    """All that a report says of a run."""

    run: BoardRun
    summary: RunSummary
    tested: tuple[Tested, ...]

    @property
    def good(self) -> bool:
        """Whether every point passed, at once or later."""
        return self.summary.done == self.summary.points == self.summary.passed_first + self.summary.false_opens


def limits_in_words(limits: Limits | None) -> str:
    """Return limits as people write them."""
    if limits is None:
        return ""
    low, high = with_unit(limits.low, limits.unit), with_unit(limits.high, limits.unit)
    if low and high:
        return f"{low} .. {high}"
    return f"at least {low}" if low else f"at most {high}"


def report_of(run: BoardRun, records: Sequence[PointRecord]) -> RunReport:
    """Put a run and its records together; the figures are those of the records."""
    by_test = {(record.point, record.method): record for record in records}
    tested = tuple(
        Tested(number, test, place, by_test.get((test.point, test.method)))
        for number, (test, place) in enumerate(zip(run.plan.tests, run.places, strict=True), start=1)
    )
    figures = summarise(len(run.plan.tests), records)
    if run.summary is not None:
        reference = ("reference_first_ohm", "reference_last_ohm")
        figures = figures.model_copy(update={name: getattr(run.summary, name) for name in reference})
    return RunReport(run, figures, tested)


class NoRun(LookupError):
    """There is no such run; the message says which there are, `advice` what to do."""

    def __init__(self, message: str, advice: str) -> None:
        super().__init__(message)
        self.advice = advice


def read_run(journal: Path, run_id: str) -> RunReport:
    """Read a run out of the journal; raise `NoJournal`, or `NoRun` where there is no such run."""
    with JournalReader(journal) as reader:
        run = reader.run(run_id)
        if run is None:
            known = ", ".join(reader.run_ids(5))
            if not known:
                none_yet = f"no board has been tested yet: no run is in {journal}"
                raise NoRun(none_yet, "test one first: `reprobe run PLAN --board-id ID`")
            raise NoRun(f"no run {run_id!r} is in the journal; the newest are {known}", "name one of these, or `last`")
        return report_of(run, list(reader.points(run.id)))


def pictures_of(record: PointRecord) -> list[Path]:
    """Return the kept pictures of a point that tell something and can still be read, the first look's first."""
    folder = Path(record.pictures) if record.pictures else None
    if folder is None or not folder.is_dir():
        return []
    found = [path for pattern in PICTURES for path in folder.glob(pattern) if path.is_file()]
    telling = [path for path in found if path.stem.endswith(TELLING)]
    return sorted(telling or found, key=_told_first)


def caption_of(picture: Path) -> str:
    """Say what a kept picture shows; one of another name is told by its name."""
    look, _, drawn = picture.stem.partition("-")
    if look not in LOOK_WORDS or drawn not in KIND_WORDS:
        return picture.stem
    return f"{LOOK_WORDS[look]}: {KIND_WORDS[drawn]}".capitalize()


def _told_first(path: Path) -> tuple[bool, bool, str]:
    """Return a key by which the first look comes first, and of a look where the needle came down."""
    return not path.stem.startswith("before"), not path.stem.endswith(TELLING[0]), path.stem
