"""Print what a campaign reached, the points where something is wrong, and what a point took."""

from __future__ import annotations

import statistics
from collections.abc import Sequence

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from daemon.tools.demo.truth_log import Stroke
from tests.bench.nets.judge import Row, counts, wrong
from tests.bench.nets.records import Station, Visit
from tests.bench.nets.single import first_open

WORST = 20
FILM_OHM = 0.01
COUNTED = "Judged by the simulated station's truth log alone; bounds of shares are exact (Clopper and Pearson)."


def show(console: Console, visits: Sequence[Visit], stations: dict[int, Station], rows: Sequence[Row]) -> None:
    """Print everything."""
    console.print(_boards(visits, stations))
    console.print(_rungs(visits))
    console.print(_bounds(rows))
    console.print(COUNTED, style="dim")
    bad = wrong(visits, stations)
    errors = [(one, [one.reason]) for one in visits if one.verdict.startswith("error:")]
    if bad or errors:
        console.print(_wrong([*bad, *errors]))


def _boards(visits: Sequence[Visit], stations: dict[int, Station]) -> Table:
    """List the stations: their verdicts, and seconds a point."""
    names = list(counts(visits))
    table = Table(title="Boards", title_justify="left", title_style="bold")
    for head in ("seed", "board", "boards", "points", *names, "s/point first", "s/point all", "set-up s", "trouble"):
        table.add_column(head, justify="left" if head in ("board", "trouble") else "right")
    for seed, station in sorted(stations.items()):
        own = [one for one in visits if one.seed == seed]
        found = counts(own)
        first = [one.simulated_s for one in own if one.verdict == "pass_first"]
        table.add_row(
            str(seed), station.board, str(station.boards), str(len(own)), *[str(found[name]) for name in names],
            _mean(first), _mean([one.simulated_s for one in own]), f"{station.set_up_s:.0f}",
            escape(station.broken or ""),
        )  # fmt: skip
    return table


def _rungs(visits: Sequence[Visit]) -> Table:
    """Say for each truth of the first touch what came of it."""
    table = Table(title="First touch by the truth, and how it ended", title_justify="left", title_style="bold")
    names = list(counts(visits))
    for head in ("first touch", "points", *names, "by rung"):
        table.add_column(head, justify="left" if head in ("first touch", "by rung") else "right")
    truths = {
        "good": [one for one in visits if one.sound and first_open(one) is None],
        "misplaced": [one for one in visits if first_open(one) == "misplaced"],
        "film or debris": [one for one in visits if first_open(one) == "soiled"],
        "broken net": [one for one in visits if not one.sound],
    }
    for name, own in truths.items():
        rungs: dict[str, int] = {}
        for one in own:
            if one.rung:
                rungs[one.rung] = rungs.get(one.rung, 0) + 1
        found = counts(own)
        by = ", ".join(f"{rung} {count}" for rung, count in sorted(rungs.items(), key=lambda item: -item[1]))
        table.add_row(name, str(len(own)), *[str(found[each]) for each in names], by)
    return table


def _bounds(rows: Sequence[Row]) -> Table:
    table = Table(title="Bounds", title_justify="left", title_style="bold")
    for head in ("bound", "measured", "95 % sure", ""):
        table.add_column(head)
    words = {True: ("reached", "green"), False: ("MISSED", "bold red"), None: ("", "dim")}
    for row in rows:
        word, style = words[row.reached]
        table.add_row(row.bound, row.measured, row.sure, f"[{style}]{word}[/]" if word else "")
    return table


def _wrong(bad: Sequence[tuple[Visit, list[str]]]) -> Table:
    table = Table(title=f"Wrong: {len(bad)}", title_justify="left", title_style="bold")
    for head in ("board", "point", "net", "sound", "verdict", "what", "strokes by the truth"):
        table.add_column(head)
    for one, names in bad[:WORST]:
        words = (", ".join(names), "; ".join(_stroke(stroke) for stroke in one.happened.strokes))
        table.add_row(one.board_id, one.point, one.net, str(one.sound), one.verdict, *map(escape, words))
    return table


def _mean(values: Sequence[float]) -> str:
    return f"{statistics.mean(values):.2f}" if values else "-"


def _stroke(stroke: Stroke) -> str:
    """Return a stroke in a few words: what the needle stood on, and through what film."""
    film = f"{stroke.film} {stroke.soil_ohm:.3g} ohm" if stroke.soil_ohm > FILM_OHM else ""
    words = (
        "+".join(stroke.nets) or stroke.material,
        "" if stroke.first else "pump",
        "seen" if stroke.seen else "",
        film,
    )
    return " ".join(filter(None, words))
