"""Page layout: panels side by side, the verdict in words on top, numbers below each, the colours at the foot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from vision.annotate.sheet import FONT, INK, TEXT_SCALE, Colour, text_size, write
from vision.core import Bgr

PANEL_ROOM = 700
"""A panel is magnified as far as it stays about this high, or wide."""
SMALLEST_PAGE, MARGIN, LINE = 560, 12, 20
TITLE_FONT, TITLE_SCALE, TITLE_LINE = cv2.FONT_HERSHEY_DUPLEX, 0.58, 24
PAPER: Colour = (34, 32, 30)
PALE: Colour = (205, 205, 205)
GOOD: Colour = (52, 92, 40)
"""The verdict's ground: something was found, or not."""
BAD: Colour = (48, 44, 132)


@dataclass(frozen=True, slots=True)
class PagePanel:
    """Hold one finished image with its title, its numbers, and what its colours mean."""

    title: str
    pixels: Bgr
    facts: tuple[str, ...]
    legend: tuple[tuple[Colour, str], ...]


def fitting_zoom(size_px: tuple[int, int]) -> float:
    """Return how far a piece of (width, height) px is magnified: a whole number unless it is large."""
    zoom = PANEL_ROOM / max(size_px)
    return float(min(int(zoom), 8)) if zoom >= 2.0 else zoom


def page(verdict: str, panels: Sequence[PagePanel], *, good: bool) -> Bgr:
    """Return the page as (H, W, 3) uint8 BGR."""
    width = max(sum(panel.pixels.shape[1] + MARGIN for panel in panels) + MARGIN, SMALLEST_PAGE)
    head = _lines(verdict, width - 2 * MARGIN, TITLE_SCALE, TITLE_FONT)
    key = _key_rows(panels, width - 2 * MARGIN)
    top = len(head) * TITLE_LINE + 14
    high = max(panel.pixels.shape[0] for panel in panels)
    facts = max(len(_facts(panel)) for panel in panels)
    height = top + LINE + 6 + high + 4 + LINE * (facts + len(key)) + MARGIN
    paper = np.full((height, width, 3), PAPER, dtype=np.uint8)
    paper[:top] = GOOD if good else BAD
    for row, text in enumerate(head):
        write(paper, text, MARGIN, 24 + row * TITLE_LINE, INK, TITLE_SCALE, TITLE_FONT)
    x = MARGIN
    for panel in panels:
        write(paper, panel.title, x, top + LINE, PALE)
        y = top + LINE + 6
        paper[y : y + panel.pixels.shape[0], x : x + panel.pixels.shape[1]] = panel.pixels
        for row, text in enumerate(_facts(panel), start=1):
            write(paper, text, x, y + high + row * LINE, INK)
        x += panel.pixels.shape[1] + MARGIN
    for row, entries in enumerate(key):
        _write_key(paper, entries, height - MARGIN - (len(key) - 1 - row) * LINE)
    return paper


def _facts(panel: PagePanel) -> list[str]:
    room = max(panel.pixels.shape[1], SMALLEST_PAGE - 2 * MARGIN)
    return [row for fact in panel.facts for row in _lines(fact, room, TEXT_SCALE, FONT)]


def _lines(text: str, room: int, scale: float, font: int) -> list[str]:
    """Break a text at its blanks so that each line fits."""
    rows = [""]
    for word in text.split(" "):
        longer = f"{rows[-1]} {word}" if rows[-1] else word
        if rows[-1] and text_size(longer, scale, font)[0] > room:
            rows.append(word)
        else:
            rows[-1] = longer
    return rows


def _key_rows(panels: Sequence[PagePanel], room: int) -> list[list[tuple[Colour, str]]]:
    """Return the legend, each colour with all it means, broken into rows that fit."""
    meanings: dict[Colour, list[str]] = {}
    for panel in panels:
        for colour, meaning in panel.legend:
            meanings.setdefault(colour, []).append(meaning)
    rows: list[list[tuple[Colour, str]]] = []
    left = 0
    for colour, texts in meanings.items():
        entry = colour, " / ".join(texts)
        needed = _entry_width(entry[1])
        if not rows or needed > left:
            rows.append([])
            left = room
        rows[-1].append(entry)
        left -= needed
    return rows


def _entry_width(text: str) -> int:
    return 20 + text_size(text)[0] + 16


def _write_key(paper: Bgr, entries: Sequence[tuple[Colour, str]], y: int) -> None:
    x = MARGIN
    for colour, text in entries:
        cv2.rectangle(paper, (x, y - 11), (x + 13, y + 2), colour, -1)
        write(paper, text, x + 20, y, PALE)
        x += _entry_width(text)
