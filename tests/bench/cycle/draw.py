"""Draw the timeline of a correction from what a run of the cycle bench has kept.

    python -m tests.bench.cycle --keep FOLDER
    python -m tests.bench.cycle.draw FOLDER [-o FILE.png]

Of all corrections with one move it draws the one of median length.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from daemon.config.model import load_config
from tests.bench.cycle.line import exchanges, without_check_at_rest
from tests.bench.cycle.station import follower
from tests.bench.cycle.timeline import MARKS, Span, Timeline, corrections

INK, PALE = "#1c2330", "#e3e7ee"
COLOURS = {
    "triggered": "#c9cfda", "look": "#9ec3e6", "move": "#a8d5ba", "verify": "#f0cf8e",
    "white": "#f7f3d0", "red": "#d9756c",
}  # fmt: skip
CAMERA, MOVES, LINE = "#5f6b80", "#1f6f54", "#8a93a6"
ROWS = ("state", "light", "camera", "X", "Y", "Z", "line")
HEIGHT = 0.62
ROOM = 0.06
"""Share of the whole time that a bar needs for a label."""


def read(folder: Path) -> list[Timeline]:
    """Return the corrections that a folder's record shows."""
    part = exchanges((folder / "line.jsonl").read_text().splitlines())
    drives = follower(load_config(folder / "station.toml"), part)
    drives.follow(part)
    return corrections((folder / MARKS).read_text().splitlines(), without_check_at_rest(part), drives.legs)


def median(some: list[Timeline]) -> Timeline:
    """Return the one of median length."""
    return sorted(some, key=lambda one: one.seconds)[len(some) // 2]


def draw(one: Timeline, file: Path) -> None:
    """Draw one row each for states, light, camera, axes and line."""
    figure = Figure(figsize=(10.4, 3.6), layout="constrained", facecolor="white")
    axes = figure.subplots()
    axes.set(xlim=(0.0, 1e3 * one.seconds), ylim=(len(ROWS) - 0.5, -0.5), xlabel="ms since the correction began")
    for span in one.states:
        _bar(axes, "state", span, COLOURS[span.name], span.name)
    for span in one.lamps:
        if span.name in COLOURS:
            _bar(axes, "light", span, COLOURS[span.name], span.name)
    for number, (frame, exposure) in enumerate(zip(one.frames, one.exposures, strict=True)):
        lane = number % 2  # one is still on its way when the next is exposed
        _bar(axes, "camera", frame, PALE, lane=lane)
        _bar(axes, "camera", exposure, CAMERA, lane=lane)
    for span in one.moves:
        if span.name.upper() in ROWS:
            _bar(axes, span.name.upper(), span, MOVES)
    for span in one.line:
        _bar(axes, "line", span, LINE, edge=False)
    for span in one.states[1:]:
        axes.axvline(1e3 * span.begun_s, color=PALE, linewidth=0.8, zorder=0)
    axes.set_yticks(range(len(ROWS)), ROWS)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(left=False, colors=INK)
    title = f"One correction: two looks and a move in {one.seconds:.2f} s, {len(one.line)} requests on the line"
    axes.set_title(title, loc="left", fontsize=10.5, color=INK)
    figure.savefig(file, dpi=100)


def _bar(
    axes: Axes, row: str, span: Span, colour: str, label: str = "", *, edge: bool = True, lane: int | None = None
) -> None:
    """Draw a span in its row, of which `lane` 0 is the upper half and 1 the lower; a label where there is room."""
    wide_ms, begun_ms = 1e3 * (span.over_s - span.begun_s), 1e3 * span.begun_s
    high = HEIGHT if lane is None else HEIGHT / 2
    place = ROWS.index(row) + (0.0 if lane is None else (lane - 0.5) * high)
    axes.barh(place, wide_ms, high, begun_ms, color=colour, edgecolor=INK if edge else "none", linewidth=0.5)
    if label and wide_ms > ROOM * (axes.get_xlim()[1] - axes.get_xlim()[0]):
        axes.text(begun_ms + wide_ms / 2, place, label, ha="center", va="center", fontsize=8.5, color=INK)


def main() -> None:
    """Read the record and draw."""
    options = argparse.ArgumentParser(prog="python -m tests.bench.cycle.draw", description=__doc__.splitlines()[0])
    options.add_argument("folder", type=Path, help="what --keep of the cycle bench has left")
    options.add_argument("-o", "--out", type=Path, default=Path("out/correction.png"))
    chosen = options.parse_args()
    missing = [name for name in ("line.jsonl", MARKS, "station.toml") if not (chosen.folder / name).is_file()]
    if missing:
        options.error(f"{chosen.folder} has no {', '.join(missing)}: run the cycle bench with --keep {chosen.folder}")
    found = read(chosen.folder)
    if not found:
        raise SystemExit(f"{chosen.folder} has no correction with one move: run the bench with more --rounds")
    chosen.out.parent.mkdir(parents=True, exist_ok=True)
    draw(median(found), chosen.out)
    print(f"{chosen.out}: the median of {len(found)} corrections with one move")


if __name__ == "__main__":
    main()
