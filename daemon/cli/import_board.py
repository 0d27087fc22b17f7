"""`reprobe board`: import of a board's CAD."""

from __future__ import annotations

import importlib.util
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from rich.markup import escape
from rich.table import Table

from daemon.cli.config_file import load
from daemon.cli.long_table import Justify, print_long_table
from daemon.cli.output import USAGE, AsJson, fail, out, say_json
from daemon.domain.board import Board, BoardPoint
from daemon.tools.board_import import Coverage, Options, import_boards, net_coverage

if TYPE_CHECKING:
    from daemon.config.model import Config

app = typer.Typer()
_HERE = Path("station.toml")
_COLUMNS: dict[str, Justify] = {
    "name": "left", "kind": "left", "shape": "left", "x mm": "right", "y mm": "right", "room um": "right",
    "net": "left", "rank": "right", "probe": "left",
}  # fmt: skip


@app.command()
def board(
    path: Annotated[Path, typer.Argument(help="Folder or zip with Gerber, Excellon and a netlist.")],
    side: Annotated[Literal["top", "bottom"], typer.Option(help="The side that is probed.")] = "top",
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Write the board file here; packed if it ends in .gz.")
    ] = None,
    layer: Annotated[
        list[str] | None, typer.Option(help="ROLE=FILE: what a file is, as in top_mask=art7.gbr; may be repeated.")
    ] = None,
    netlist: Annotated[Path | None, typer.Option(help="The file that names the pads, where there are two.")] = None,
    copy: Annotated[int | None, typer.Option(min=1, help="Of a panel: the board that is probed, from 1.")] = None,
    bare: Annotated[bool, typer.Option("--bare", help="No parts are fitted: nothing hides the pads.")] = False,
    config: Annotated[
        Path | None,
        typer.Option("--config", "-c", help="A station, to say what it can reach; ./station.toml where there is one.",
                     envvar="REPROBE_CONFIG"),
    ] = None,
    as_json: AsJson = False,
) -> None:  # fmt: skip
    """Read a board's CAD: say which nets can be probed, from where, and why the rest cannot; write the board file."""
    options = Options(layers=_layers(layer or []), netlist=netlist, copy=copy, bare=bare, keep=not comes_along(path))
    try:
        boards = import_boards(path, side, options)
    except ValueError as exc:
        fail(str(exc), code=USAGE)
    read = boards[side]
    reach = _reach(read, config)
    if output is not None:
        read = _with_seat(read)
        _write(read, output)
    coverage = net_coverage(list(boards.values()))
    if as_json:
        say_json(_facts(read, coverage, reach))
        return
    _print_coverage(read, coverage)
    if output is not None:
        out.print(_seat_told(read), highlight=False, soft_wrap=True)
    _print_notes(read, reach)
    _print_points(read)


def comes_along(path: Path) -> bool:
    """Whether a folder is the program's own, in which nothing is to be kept."""
    spec = importlib.util.find_spec("sim_hw")
    return spec is not None and spec.origin is not None and Path(spec.origin).parent in path.resolve().parents


def _layers(given: list[str]) -> dict[str, list[Path]]:
    found: dict[str, list[Path]] = {}
    for text in given:
        role, equals, file = text.partition("=")
        if not (role and equals and file):
            fail(f"--layer {text}: give ROLE=FILE, as in top_mask=art7.gbr", code=USAGE)
        found.setdefault(role.strip(), []).append(Path(file.strip()))
    return found


def _with_seat(read: Board) -> Board:
    """Return the board with the places by which a station aligns it; finding them takes seconds."""
    from daemon.station.board_references import BoardSides  # noqa: PLC0415  # only a board that is kept needs it

    return read.model_copy(update={"seat": BoardSides(read).seat})


def _seat_told(read: Board) -> str:
    """Say whether `align` will do by itself."""
    from daemon.procedures.seat import LEAST_PLACES  # noqa: PLC0415  # as above
    from vision.registration import UNIQUE_SCORE  # noqa: PLC0415  # as above

    unique = sum(place.rival <= UNIQUE_SCORE for place in read.seat)
    if unique >= LEAST_PLACES:
        return f"seat: {unique} places are found once on the board; `reprobe align` looks at them"
    return (
        f"seat: {unique} places are found once on the board, {LEAST_PLACES} are needed: "
        "give `reprobe align` three or more targets far apart, as in --on TP1 --on R4.1 --on U2.3"
    )


def _write(read: Board, output: Path) -> None:
    try:
        read.save(output)
    except OSError as exc:
        fail(
            f"{output} cannot be written: {exc.strerror}",
            advice="see that its folder is there and that you may write into it",
            code=USAGE,
        )


@dataclass(frozen=True)
class _Reach:
    """Which points a station cannot reach -> why, and where its nest puts the board; None without a station."""

    beyond: dict[str, str] = field(default_factory=dict)
    nest: str | None = None
    notes: tuple[str, ...] = ()


def _reach(read: Board, config: Path | None) -> _Reach:
    """Say what a station reaches: the named one, which must be right, or the one that lies here, if it is right."""
    if config is None and not _HERE.is_file():
        return _Reach()
    from daemon.config.model import ConfigError, load_config  # noqa: PLC0415  # only a board held against a station

    if config is not None:
        return _reach_of(load(config), read)
    try:
        return _reach_of(load_config(_HERE), read)
    except ConfigError as exc:
        return _Reach(notes=(f"{_HERE} was not asked for its reach: {' '.join(str(exc).split())}",))


def _reach_of(station: Config, read: Board) -> _Reach:
    axes, pose = station.axes, station.board
    nest = (
        f"{station.station.name}: X {axes.x.minimum / 1e3:g} to {axes.x.maximum / 1e3:g} mm, "
        f"Y {axes.y.minimum / 1e3:g} to {axes.y.maximum / 1e3:g} mm; the nest puts the board's lower left corner at "
        f"{pose.origin_x_um / 1e3:g}, {pose.origin_y_um / 1e3:g} mm, turned by {pose.rotation_deg:g} deg"
    )
    from daemon.station.reach import beyond_reach  # noqa: PLC0415  # as above

    return _Reach(beyond_reach(station, read.test_points()), nest)


def _facts(read: Board, coverage: Coverage, reach: _Reach) -> dict[str, Any]:
    """Return what is said, for machines; the layers stand in the board file only."""
    return {
        "coverage": {
            "nets": coverage.nets,
            "top": len(coverage.top),
            "bottom": len(coverage.bottom),
            "either": len(coverage.either),
            "neither": coverage.neither,
        },
        "station": reach.nest,
        "out_of_reach": reach.beyond,
        **read.model_dump(mode="json", exclude={"layers"}),
        "notes": [*read.notes, *reach.notes],
    }


def _print_coverage(read: Board, coverage: Coverage) -> None:
    width, height = read.width_um / 1e3, read.height_um / 1e3
    table = Table(title=f"{escape(read.name)}, {width:.2f} x {height:.2f} mm: {coverage.nets} nets")
    for column in ("side", "nets with a point", "share"):
        table.add_column(column, justify="left" if column == "side" else "right")
    for name, nets in (("top", coverage.top), ("bottom", coverage.bottom), ("one or the other", coverage.either)):
        table.add_row(name, str(len(nets)), f"{len(nets) / coverage.nets:.1%}" if coverage.nets else "")
    out.print(table)
    for net, why in coverage.neither.items():
        out.print(f"no point on {net}: {why}", highlight=False, soft_wrap=True, markup=False)


def _print_notes(read: Board, reach: _Reach) -> None:
    for note in (*read.notes, *reach.notes):
        out.print(f"note: {note}", highlight=False, soft_wrap=True, markup=False)
    for copy in read.copies:
        place = f"{copy.x_um / 1e3:.2f}, {copy.y_um / 1e3:.2f} mm, turned by {copy.turn_deg:g} deg"
        out.print(f"copy {copy.name}: its origin at {place}", highlight=False, markup=False)
    if reach.nest is not None:
        out.print(reach.nest, highlight=False, soft_wrap=True, markup=False)
        offered = len(read.test_points())
        out.print(f"{offered - len(reach.beyond)} of {offered} points within reach", highlight=False, markup=False)
    for name, why in reach.beyond.items():
        out.print(f"{name} is {why}", highlight=False, soft_wrap=True, markup=False)


def _print_points(read: Board) -> None:
    rows: list[tuple[str, ...]] = []
    for p in sorted(read.points, key=lambda p: (p.rank is None, p.net or "", p.rank or 0)):
        room = f"{p.room_um:.0f}" if p.room_um is not None else ""
        rank = str(p.rank) if p.rank is not None else ""
        place = f"{p.x_um / 1e3:.3f}", f"{p.y_um / 1e3:.3f}"
        rows.append((p.name, p.kind, p.shape, *place, room, p.net or "", rank, p.why_not or "yes"))
    told = f"{read.name}, {read.side}: {summary(read.test_points())} may be touched"
    print_long_table(told, _COLUMNS, rows)
    for name, why in read.hidden.items():
        out.print(f"{name}: {why}", highlight=False, markup=False)


def summary(points: Iterable[BoardPoint]) -> str:
    """Count points by kind, for people."""
    counts = Counter(p.kind for p in points)
    return ", ".join(f"{n} {kind}{'s' if n > 1 else ''}" for kind, n in sorted(counts.items())) or "none"
