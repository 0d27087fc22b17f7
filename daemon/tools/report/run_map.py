"""Map of a run: the board from the probed side, each point by its verdict's colour, shape and letter, as SVG."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from markupsafe import Markup, escape
from scipy.spatial import cKDTree

from daemon.tools.report.run_facts import RunReport, Tested

VIEW = 1000.0
"""Width or height of the drawing, whichever is larger, in its own units."""
LARGEST, SMALLEST = 20.0, 9.0
"""Radius of a mark; between them it is as large as lets most neighbours stand beside each other."""
CROWDED = 0.1
"""Share of the points that may overlap their neighbour: two at one place do not make all marks small."""
MARGIN = 26.0


def draw_map(report: RunReport) -> Markup:
    """Return the map as inline SVG whose colours are those of the page's style sheet."""
    board = report.run.board
    scale = VIEW / max(board.width_um, board.height_um, 1.0)
    width, height = board.width_um * scale, board.height_um * scale
    radius = _radius([(one.place.x_um * scale, one.place.y_um * scale) for one in report.tested])
    label = f"board {board.name}, {board.side} side, with its points by verdict"
    body = Markup("").join(
        _mark(tested, tested.place.x_um * scale, height - tested.place.y_um * scale, radius)
        for tested in sorted(report.tested, key=lambda one: one.style.letter == "P", reverse=True)
    )
    box = f"{-MARGIN:.1f} {-MARGIN:.1f} {width + 2 * MARGIN:.1f} {height + 2 * MARGIN:.1f}"
    return Markup(
        '<svg class="map" viewBox="{}" role="img" aria-label="{}">'
        '<rect class="board" x="0" y="0" width="{:.1f}" height="{:.1f}" rx="6"/>{}</svg>'
    ).format(box, label, width, height, body)


def _radius(places: Sequence[tuple[float, float]]) -> float:
    """Return the radius of marks at these places, of the drawing."""
    at = np.array(places)
    if len(at) < 2:
        return LARGEST
    distances = np.asarray(cKDTree(at).query(at, k=2)[0])
    return float(np.clip(np.quantile(distances[:, 1], CROWDED) / 2.0, SMALLEST, LARGEST))


def _mark(tested: Tested, x: float, y: float, radius: float) -> Markup:
    """Return one point; a click on it leads to its line in the table."""
    test = tested.test
    words = ", ".join(filter(None, (test.point, test.net, tested.style.words, tested.last)))
    return Markup(
        '<a href="#p{}"><g class="mark v-{}"><title>{}</title>{}'
        '<text x="{:.1f}" y="{:.1f}" font-size="{:.1f}">{}</text></g></a>'
    ).format(
        tested.number, tested.style.name, words, _shape(tested.style.letter, x, y, radius),
        x, y + radius * 0.42, radius * 1.2, tested.style.letter,
    )  # fmt: skip


def _shape(letter: str, x: float, y: float, r: float) -> Markup:
    """Return the outline of a mark: trouble is told by its corners, too."""
    if letter in "P-N":
        return Markup('<circle cx="{:.1f}" cy="{:.1f}" r="{:.1f}"/>').format(x, y, r)
    return Markup('<polygon points="{}"/>').format(
        escape(" ".join(f"{a:.1f},{b:.1f}" for a, b in _corners(letter, x, y, r)))
    )


def _corners(letter: str, x: float, y: float, r: float) -> Iterator[tuple[float, float]]:
    around = {
        "R": ((0, -1.25), (1.25, 0), (0, 1.25), (-1.25, 0)),
        "F": ((-1, -1), (1, -1), (1, 1), (-1, 1)),
        "O": ((-0.55, -1.2), (0.55, -1.2), (1.2, 0), (0.55, 1.2), (-0.55, 1.2), (-1.2, 0)),
        "C": ((0, -1.5), (1.35, 1.05), (-1.35, 1.05)),
    }[letter]
    yield from ((x + r * dx, y + r * dy) for dx, dy in around)
