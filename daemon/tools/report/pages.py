"""Pages by kind of record: which module draws which, and what may be compared with what."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from daemon.platform.atomic_file import replace_whole
from daemon.storage.calibration_records import AlignmentRecord, Record
from daemon.tools.report import alignment, backlash, mapping, rotation, surface
from daemon.tools.report.page import Page, render, write_text

ROOMS: Final[dict[str, Any]] = {
    "map": mapping,
    "rotation": rotation,
    "surface": surface,
    "backlash": backlash,
    "alignment": alignment,
}
"""Kind -> module with SUBJECT, `verdict`, `numbers`, `since` and `plots`; a new kind is a module and a line here."""


def make_page(record: Record, previous: Record | None = None) -> Page:
    """Return the page of a record, compared with the previous one of its kind and station.

    ValueError if the record cannot be drawn or the previous one is of another kind or station.
    """
    room = ROOMS[record.what]
    previous, notes = _comparable(record, previous)
    return Page(
        kind=record.what,
        subject=room.SUBJECT,
        station=record.station,
        made_at=record.made_at,
        job=record.job,
        verdict=room.verdict(record),
        numbers=room.numbers(record),
        plots=room.plots(record, previous),
        earlier=room.numbers(previous) if previous else (),
        earlier_made_at=previous.made_at if previous else "",
        since=room.since(record, previous) if previous else "",
        notes=notes,
    )


def _comparable(record: Record, previous: Record | None) -> tuple[Record | None, tuple[str, ...]]:
    """Return the previous record if there is something to compare, and what is to be said if there is not."""
    if previous is None:
        return None, ()
    if previous.what != record.what:
        raise ValueError(
            f"the previous record is of a {previous.what}, this one of a {record.what}; name one of its kind"
        )
    if previous.station != record.station:
        raise ValueError(
            f"the previous record is of station {previous.station!r}, this one of {record.station!r}; "
            "name one of the same station"
        )
    if isinstance(record, AlignmentRecord) and isinstance(previous, AlignmentRecord):
        if not alignment.comparable(record, previous):
            other = f"{previous.board}, {previous.side} side"
            return None, (f"The previous alignment was of {other}: there is nothing to compare.",)
    elif previous.probe != record.probe:
        return previous, ("The previous calibration was made with another probe: what changed may be the needle.",)
    return previous, ()


def write_page(record: Record, previous: Record | None, path: Path) -> None:
    """Write the page of a record as one HTML file, whole or not at all.

    Raises ValueError if the record cannot be drawn, OSError if the file cannot be written.
    """
    text = render(make_page(record, previous))
    replace_whole(path, lambda beside: write_text(beside, text))
