"""The page of a month: `python -m daemon.tools.report.month --journal FILE --month 2026-11 --station NAME -o PAGE`.

A process of its own, as every page with plots is. Exit status 0: written. 1: a file could not be read or written.
2: the call is wrong. With 1 and 2 one line on stderr says why.
"""

from __future__ import annotations

import re
import sys
from datetime import UTC, datetime
from pathlib import Path

from daemon.tools.report.command import NOT_WRITTEN, OK, WRONG, Parser, own_settings, say


def main(arguments: list[str] | None = None) -> int:
    """Run the command; return its exit status."""
    parser = Parser(prog="python -m daemon.tools.report.month", description=__doc__)
    parser.add_argument("--journal", type=Path, required=True)
    parser.add_argument("--month", required=True)
    parser.add_argument("--station", required=True)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--charts", action="store_true", help="only the charts, as JSON")
    given = parser.parse_args(arguments)
    span = month_span(given.month)
    if span is None:
        return say(f"{given.month!r} is no month; write it as 2026-11", WRONG)
    with own_settings():
        return _draw(given.journal, given.station, span, given.output, only_charts=given.charts)


def month_span(text: str) -> tuple[datetime, datetime] | None:
    """Return the first moment of a month written as 2026-11, and of the next; None if it is none. UTC."""
    if not re.fullmatch(r"\d{4}-\d{2}", text):
        return None
    year, month = int(text[:4]), int(text[5:])
    if not (1 <= month <= 12 and 1 <= year < 9999):
        return None
    after = (year + 1, 1) if month == 12 else (year, month + 1)
    return datetime(year, month, 1, tzinfo=UTC), datetime(*after, 1, tzinfo=UTC)


def _draw(
    journal: Path, station: str, span: tuple[datetime, datetime], output: Path, *, only_charts: bool
) -> int:  # fmt: skip
    # Only now: these bring matplotlib, which reads its settings when it is imported.
    from daemon.storage.journal_reader import NoJournal  # noqa: PLC0415
    from daemon.tools.report.month_facts import read_month  # noqa: PLC0415
    from daemon.tools.report.month_page import write_charts, write_month  # noqa: PLC0415

    try:
        (write_charts if only_charts else write_month)(read_month(journal, station, *span), output)
    except NoJournal as exc:
        return say(f"{exc}: {exc.advice}", NOT_WRITTEN)
    except OSError as exc:
        return say(str(exc), NOT_WRITTEN)
    return OK


if __name__ == "__main__":
    sys.exit(main())
