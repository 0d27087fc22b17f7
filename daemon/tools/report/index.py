"""Index of a folder of pages, read from the pages' own heads."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from datetime import UTC, datetime
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import quote

from daemon.platform.atomic_file import replace_whole
from daemon.tools.report.page import environment, write_text

INDEX = "index.html"
MARK = '<meta name="reprobe-index"'
"""Stands in every index of ours, so that nobody else's is overwritten in passing."""
HEAD_CHARS = 20_000
"""The head ends far before; the plots behind it need not be read."""
_NAMES = ("kind", "station", "made-at", "good", "verdict")


@dataclass(frozen=True)
class Entry:
    """One page, as its head describes it."""

    href: str
    kind: str
    station: str
    made_at: str
    good: bool
    because: str

    @property
    def moment(self) -> datetime:
        """When the calibration was made."""
        moment = datetime.fromisoformat(self.made_at)
        return moment if moment.tzinfo else moment.replace(tzinfo=UTC)


class _Head(HTMLParser):
    """Collects the `reprobe-*` meta lines of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.said: dict[str, str] = {}

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Keep a meta line's name and content."""
        given = dict(attrs)
        name = given.get("name") or ""
        if tag == "meta" and name.startswith("reprobe-"):
            self.said[name.removeprefix("reprobe-")] = given.get("content") or ""


def read_entry(page: Path) -> Entry | None:
    """Read what a page says of itself; None if it is not a calibration's page."""
    head = _Head()
    with page.open(encoding="utf-8", errors="replace") as file:
        head.feed(file.read(HEAD_CHARS))
    if not all(name in head.said for name in _NAMES):
        return None
    kind, station, made_at, good, because = (head.said[name] for name in _NAMES)
    entry = Entry(quote(page.name), kind, station, made_at, good == "yes", because)
    try:
        entry.moment  # noqa: B018 - a date that cannot be read makes it somebody else's page
    except ValueError:
        return None
    return entry


def renew_index(folder: Path) -> bool:
    """Write the index unless the folder has an `index.html` that is not one of ours; say whether it was written."""
    present = folder / INDEX
    if present.exists() and MARK not in present.read_text(encoding="utf-8", errors="replace")[:HEAD_CHARS]:
        return False
    write_index(folder)
    return True


def write_index(folder: Path) -> Path:
    """Write `index.html` into a folder: all its pages by kind, newest first. Return its path; OSError as it comes."""
    found = [entry for page in folder.glob("*.html") if page.name != INDEX and (entry := read_entry(page))]
    found.sort(key=lambda entry: (entry.moment, entry.href), reverse=True)
    found.sort(key=lambda entry: entry.kind)
    groups = [(kind, list(entries)) for kind, entries in itertools.groupby(found, key=lambda entry: entry.kind)]
    text = environment().get_template("index.html.j2").render(groups=groups)
    path = folder / INDEX
    replace_whole(path, lambda beside: write_text(beside, text))
    return path
