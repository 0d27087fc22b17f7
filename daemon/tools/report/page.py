"""Page model and rendering: a verdict, a table of figures, plots. No calibration is named here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup


@dataclass(frozen=True)
class Number:
    """One figure of the table. `limit` is said in words because some bound from above and some both ways."""

    label: str
    value: float | str
    unit: str = ""
    digits: int = 1
    limit: str = ""
    bad: bool = False

    @property
    def text(self) -> str:
        """The value as it stands in the table."""
        return self.value if isinstance(self.value, str) else rounded(self.value, self.digits)


@dataclass(frozen=True)
class Plot:
    """One figure with the words below it."""

    title: str
    svg: Markup
    caption: str


@dataclass(frozen=True)
class PageVerdict:
    """Good or not, and the sentence that says by what figure."""

    good: bool
    because: str


@dataclass(frozen=True)
class Page:
    """Everything a page says. `earlier` is the same table of the previous calibration, empty without one."""

    kind: str
    subject: str
    """What was calibrated, as the beginning of a sentence."""
    station: str
    made_at: str
    job: str
    verdict: PageVerdict
    numbers: tuple[Number, ...]
    plots: tuple[Plot, ...]
    earlier: tuple[Number, ...] = ()
    earlier_made_at: str = ""
    since: str = ""
    """What changed since the previous calibration, in a sentence."""
    notes: tuple[str, ...] = ()
    done: str = "calibrated"
    """What was done at `made_at`."""


def rounded(value: float, digits: int) -> str:
    """Return a number with so many decimals and no minus before zero."""
    text = f"{value:.{digits}f}"
    return text.removeprefix("-") if float(text) == 0.0 else text


def spoken_time(made_at: str) -> str:
    """Return an ISO 8601 moment as people read it, in UTC; ValueError if it is none."""
    try:
        moment = datetime.fromisoformat(made_at)
    except ValueError as exc:
        raise ValueError(f"made_at is {made_at!r}, not a date and time as ISO 8601") from exc
    moment = moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment.astimezone(UTC)
    return f"{moment:%Y-%m-%d %H:%M} UTC"


@dataclass(frozen=True)
class _Row:
    """A line of the table: now, before, and what changed."""

    now: Number
    before: str
    change: str


def _rows(numbers: Sequence[Number], earlier: Sequence[Number]) -> list[_Row]:
    """Put the previous calibration's figures beside this one's, by label."""
    old = {number.label: number for number in earlier}
    rows = []
    for now in numbers:
        before = old.get(now.label)
        change = ""
        if before and isinstance(now.value, float | int) and isinstance(before.value, float | int):
            difference = now.value - before.value
            change = ("+" if difference > 0 else "") + rounded(difference, now.digits)
            change = change if float(change) else "0"
        rows.append(_Row(now, before.text if before else "", change))
    return rows


def environment() -> Environment:
    """Return the templates; everything that is put into them is escaped."""
    made = Environment(
        loader=PackageLoader("daemon.tools.report", "templates"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    made.filters["spoken_time"] = spoken_time
    return made


def render(page: Page) -> str:
    """Return the page as HTML: one file, no script, nothing fetched."""
    return environment().get_template("page.html.j2").render(page=page, rows=_rows(page.numbers, page.earlier))


def write_text(path: Path, text: str) -> None:
    """Write as UTF-8, for everybody who may enter the folder to read; to be handed to `replace_whole`."""
    path.write_text(text, encoding="utf-8")
    path.chmod(0o644)
