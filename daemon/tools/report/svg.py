"""SVG figures inside a page: their colours follow the page, their ids do not clash."""

from __future__ import annotations

import io
import re
from typing import Any, Final

import matplotlib as mpl
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure

# Each colour stands for a variable of the page's style sheet; the hex values are only its names inside matplotlib.
INK: Final = "#1c2330"
MUTED: Final = "#66708a"
GRID: Final = "#e3e7ee"
PAPER: Final = "#fdfdfe"
MAIN: Final = "#1f6f54"
SECOND: Final = "#2f5fb3"
WARM: Final = "#b97a12"
BAD: Final = "#b3261e"
BAND: Final = "#eceff4"
VARIABLES: Final = {
    INK: "--ink", MUTED: "--muted", GRID: "--grid", PAPER: "--paper", MAIN: "--main", SECOND: "--second",
    WARM: "--warm", BAD: "--bad", BAND: "--band",
}  # fmt: skip

_STYLE: Final[dict[Any, Any]] = {
    "svg.fonttype": "none",  # text stays text: it can be searched, copied and read aloud
    "text.parse_math": False,  # names come from CAD: a dollar is a dollar
    "font.size": 10.0,
    "axes.titlesize": 10.5,
    "axes.titlelocation": "left",
    "axes.labelsize": 10.0,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.facecolor": "none",
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-7, 7),
    "grid.color": GRID,
    "grid.linewidth": 0.8,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "text.color": INK,
    "legend.frameon": False,
    "legend.fontsize": 9.0,
    "figure.facecolor": "none",
    "lines.linewidth": 1.6,
    "lines.markersize": 4.5,
}
TIMES: Final = "\N{MULTIPLICATION SIGN}"
"""Stands before a magnification."""
WIDTH_IN: Final = 10.4
"""Width of a full figure; the page shows it about 100 px to the inch."""


def new_figure(
    rows: int = 1, columns: int = 1, *, height_in: float, sharex: bool = False, ratios: tuple[float, ...] | None = None
) -> tuple[Figure, list[Axes]]:
    """Return a figure over the page's full width and its axes, row by row."""
    mpl.rcParams.update(_STYLE)
    figure = Figure(figsize=(WIDTH_IN, height_in), layout="constrained")
    grid = figure.subplots(rows, columns, sharex=sharex, squeeze=False, gridspec_kw={"width_ratios": ratios})
    return figure, [axes for row in grid for axes in row]


def to_svg(figure: Figure, label: str) -> Markup:
    """Return the figure as an inline `<svg>`; `label` says in words what it shows, for readers who cannot see it."""
    text = io.StringIO()
    salt = re.sub(r"\W+", "-", label)
    with mpl.rc_context({"svg.hashsalt": salt}):
        figure.savefig(text, format="svg", metadata={"Date": None})
    svg = text.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r' id="[a-zA-Z][a-zA-Z0-9.]*(?:_\d+)+"', "", svg)
    for colour, variable in VARIABLES.items():
        svg = svg.replace(colour, f"var({variable})")
    svg = re.sub(
        r"<svg [^>]*?viewBox=\"([^\"]*)\"[^>]*>", r'<svg viewBox="\1" role="img">', svg, count=1, flags=re.DOTALL
    )
    # matplotlib escapes every text it draws, and `label` is escaped here: the result is safe markup.
    return Markup(svg.replace('role="img">', f'role="img" aria-label="{Markup.escape(label)}">', 1))  # noqa: S704


def alone(svg: Markup, colours: str) -> str:
    """Return a figure as a file of its own; `colours` is the part of a style sheet that says what each stands for."""
    spaces = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
    style = f"<style>{colours} text {{ font-family: system-ui, sans-serif !important }}</style>"
    opening, closing, rest = str(svg).partition(">")
    return opening.replace("<svg", f"<svg {spaces}", 1) + closing + style + rest
