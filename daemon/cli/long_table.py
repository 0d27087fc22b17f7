"""Tables of many rows: drawn as `rich` draws them, without the time it takes for each cell."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Literal

from rich.cells import cell_len
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from daemon.cli.formatting import visible
from daemon.cli.output import out

Justify = Literal["left", "right"]
BORDER, PADDING = "│", " "


def print_long_table(title: str, columns: Mapping[str, Justify], rows: Sequence[Sequence[str]]) -> None:
    """Print rows of plain text under their columns' names; the last column is folded where the terminal is narrow.

    `rich` draws the head, the first row and the foot, and all of it where more than the last column is to be folded.
    """
    cells = [[visible(cell) for cell in row] for row in rows]
    widths = _widths([list(columns), *cells])
    if len(cells) < 2 or widths is None:
        out.print(whole_table(title, columns, cells))
        return
    with out.capture() as drawn:
        out.print(whole_table(title, columns, cells[:1], widths))
    *head, foot = drawn.get().splitlines(keepends=True)
    body = (line for row in cells[1:] for line in _lines(row, widths, tuple(columns.values())))
    out.file.write("".join((*head, *body, foot)))


def whole_table(
    title: str, columns: Mapping[str, Justify], rows: Sequence[Sequence[str]], widths: Sequence[int | None] = ()
) -> Table:
    """Return the rows as a table that `rich` draws."""
    table = Table(title=escape(title))
    for (name, justify), width in zip(columns.items(), widths or [None] * len(columns), strict=True):
        table.add_column(name, justify=justify, overflow="fold", width=width)
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    return table


def _widths(rows: Sequence[Sequence[str]]) -> list[int] | None:
    """Return the columns' widths as `rich` finds them where only the last has to give way; None where more has to."""
    if out.options.ascii_only or any("\n" in cell or "\t" in cell for row in rows for cell in row):
        return None
    *others, last = (max(cell_len(cell) for cell in column) for column in zip(*rows, strict=True))
    left = out.width - sum(others) - 3 * (len(others) + 1) - 1  # a border and two blanks for each, and a last border
    return [*others, min(last, left)] if left >= min(last, max(others, default=1)) else None


def _lines(row: Sequence[str], widths: Sequence[int], justify: Sequence[Justify]) -> Iterator[str]:
    *cells, last = row
    for line in _folded(last, widths[-1]):
        drawn = zip((*cells, line), widths, justify, strict=True)
        yield BORDER + BORDER.join(f"{PADDING}{_justified(*cell)}{PADDING}" for cell in drawn) + f"{BORDER}\n"
        cells = [""] * len(cells)


@cache
def _folded(cell: str, width: int) -> tuple[str, ...]:
    if cell_len(cell) <= width:
        return (cell,)
    return tuple(line.plain.rstrip() for line in Text(cell).wrap(out, width, overflow="fold"))


def _justified(cell: str, width: int, justify: Justify) -> str:
    blanks = " " * (width - cell_len(cell))
    return blanks + cell if justify == "right" else cell + blanks
