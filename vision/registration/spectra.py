"""Coarse search: where in CAD the picture's neighbourhood fits, by correlation ratio over all shifts at once.

The ratio is the share of the picture's variance that lies between the means of the materials (Roche et al., 1998): it
asks that equal materials look equal, not which is how bright. Unknown cells count for nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.core import Plane
from vision.registration.drawing import Grid, Material, Planes

SEARCH_UM = 3300.0
WINDOW_UM, LARGE_WINDOW_UM = 3000.0, 6500.0
LEAST_KNOWN = 0.5
"""Of the small window: among parts little else is known there, and the search needs a large one."""
PEAK_SHARE, MOST_PEAKS = 0.5, 6
DARK_METAL = 0.2
"""Factor on the ratio where metal would not be brighter than mask."""
_APART = 5
"""Cells; nearer peaks are one."""


@dataclass(frozen=True, slots=True, eq=False)
class Spectra:
    """Fourier transforms (materials, *size) of the materials' planes, `known` of all but the unknown together.

    corner: row and column of the field at which what is transformed begins. window: the cells of the picture as
    assumed; lags (rows, columns): how many places it is tried at. board: rows and columns of the field that are not
    beside the board.
    """

    materials: tuple[Material, ...]
    planes: NDArray[np.complex64]
    known: NDArray[np.complex64]
    corner: tuple[int, int]
    size: tuple[int, int]
    window: Grid
    lags: int
    board: tuple[slice, slice]

    @property
    def tried(self) -> tuple[slice, slice]:
        """Rows and columns, of the lags, at which not all of the window lies beside the board."""
        rows, columns = (_starts(board, self.window.rows, self.lags) for board in self.board)
        return rows, columns


@dataclass(frozen=True, slots=True)
class Peak:
    """A shift of the board, um, that may be, and its correlation ratio 0..1."""

    x_um: float
    y_um: float
    ratio: float


def transform(planes: Planes, about_um: tuple[float, float]) -> Spectra:
    """Prepare the search about a place: of a small part of the picture, or of a large one where CAD says little."""
    cell = planes.grid.cell_um
    known = 1.0 - float(planes.around(*about_um, WINDOW_UM).cover[Material.UNKNOWN].mean())
    window_um = WINDOW_UM if known >= LEAST_KNOWN else LARGE_WINDOW_UM
    reach, half = round(SEARCH_UM / cell), round(window_um / cell)
    field = planes.around(*about_um, (reach + half) * cell)
    cells = 2 * (reach + half)
    size, everything = _fast(cells), slice(0, cells)
    window = planes.around(*about_um, half * cell).grid
    return _transformed(field, (0, 0), (size, size), window, 2 * reach + 1, (everything, everything))


def transform_all(planes: Planes, window_cells: int) -> Spectra:
    """Prepare the search of a square window all over square planes.

    The transform takes what it is given to repeat without end. Beside the board all is alike, so that less than the
    planes is enough: the next board only has to begin where no window sees both.
    """
    window = planes.grid.part(slice(0, window_cells), slice(0, window_cells))
    cells = planes.grid.rows
    lags, board = cells - window_cells + 1, _board(planes)
    corner = [_starts(extent, window_cells, lags).start for extent in board]
    sizes = [_fast(_period(extent, first, window_cells, cells)) for extent, first in zip(board, corner, strict=True)]
    return _transformed(planes, (corner[0], corner[1]), (sizes[0], sizes[1]), window, lags, board)


def _period(board: slice, first: int, window_cells: int, cells: int) -> int:
    """Return how many cells from `first` on are transformed: the board, and the bench beside it once."""
    # What the last window sees behind the board may be the bench before it.
    seen = min(board.stop - 1 + window_cells, cells) - board.start
    return int(max(seen, board.stop - first, window_cells))


def for_window(spectra: Spectra, window_cells: int) -> Spectra:
    """Return what `transform_all` does for a window that is no larger, by the transforms that there are."""
    grid = spectra.window
    if window_cells > grid.rows:
        raise ValueError(f"transforms for windows of {grid.rows} cells do not serve one of {window_cells}")
    lags = spectra.lags + grid.rows - window_cells
    return replace(spectra, window=grid.part(slice(0, window_cells), slice(0, window_cells)), lags=lags)


def _board(planes: Planes) -> tuple[slice, slice]:
    """Return the rows and columns in which there is anything but what lies beside the board."""
    on_board = planes.cover[Material.OFF_BOARD] < 1.0
    if not on_board.any():
        return slice(0, planes.grid.rows), slice(0, planes.grid.columns)
    rows, columns = (np.flatnonzero(on_board.any(axis=axis)) for axis in (1, 0))
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


def _starts(board: slice, window_cells: int, lags: int) -> slice:
    """Return where, along one axis, a window may start that sees some of the board."""
    return slice(max(0, board.start - window_cells + 1), min(board.stop, lags))


def _fast(cells: int) -> int:
    from scipy import fft  # noqa: PLC0415  # slow to load, see `vision.warm`

    return int(fft.next_fast_len(cells, real=True))


def _transformed(
    field: Planes, corner: tuple[int, int], size: tuple[int, int], window: Grid, lags: int, board: tuple[slice, slice]
) -> Spectra:
    from scipy import fft  # noqa: PLC0415  # as above

    present = tuple(m for m in Material if float(field.cover[m].max()) > 0.0)
    spectra = np.empty((len(present), size[0], size[1] // 2 + 1), dtype=np.complex64)
    for k, material in enumerate(present):
        spectra[k] = fft.rfft2(field.cover[material, corner[0] :, corner[1] :], s=size)
    known = spectra[[k for k, m in enumerate(present) if m is not Material.UNKNOWN]].sum(axis=0)
    return Spectra(present, spectra, known, corner, size, window, lags, board)


def search(spectra: Spectra, picture: Plane, seen: NDArray[np.bool_], *, metal: bool = True) -> list[Peak]:
    """Return the likeliest shifts, best first; `picture` and `seen` are on `spectra.window` as assumed.

    metal: there is some in view, as about a target.
    """
    ratio = correlation_ratio(spectra, picture, seen, metal=metal)
    tops = (ratio == cv2.dilate(ratio, np.ones((_APART, _APART)))) & (
        ratio > max(1e-3, PEAK_SHARE * float(ratio.max()))
    )
    rows, columns = np.nonzero(tops)
    order = np.argsort(-ratio[rows, columns])[:MOST_PEAKS]
    cell, reach = spectra.window.cell_um, spectra.lags // 2
    return [
        Peak(
            (reach - int(columns[k])) * cell,
            (reach - int(rows[k])) * cell,
            float(ratio[rows[k], columns[k]]),
        )
        for k in order
    ]


def correlation_ratio(
    spectra: Spectra, picture: Plane, seen: NDArray[np.bool_], *, metal: bool = True
) -> NDArray[np.float32]:
    """Return the ratio by where the picture's window starts in the field: row, column, (lags, lags).

    metal: there is some in view, as about a target; else a place that has none is as likely as any.
    """
    everywhere = np.zeros((spectra.lags, spectra.lags), dtype=np.float32)
    if seen.any():
        # What lies beside the board altogether has one material alone.
        everywhere[spectra.tried] = _ratio_tried(spectra, picture, seen, metal=metal)
    return everywhere


def _ratio_tried(spectra: Spectra, picture: Plane, seen: NDArray[np.bool_], *, metal: bool) -> NDArray[np.float32]:
    weight = seen.astype(np.float32)
    rows, columns = spectra.tried
    shape = rows.stop - rows.start, columns.stop - columns.start
    count, total, between = (np.zeros(shape, dtype=np.float32) for _ in range(3))
    level = np.where(seen, picture - np.float32(picture[seen].mean()), np.float32(0.0)).astype(np.float32)
    flipped = _flipped(spectra, np.stack([weight, level, level * level]))
    bright: dict[Material, tuple[Plane, Plane]] = {}
    # One material after the other: planes of all of them at once would not stay in the processor's cache.
    for material, plane in zip(spectra.materials, spectra.planes, strict=True):
        if material is Material.UNKNOWN:
            continue
        counts, sums = _valid(spectra, plane * flipped[0]), _valid(spectra, plane * flipped[1])
        count += counts
        total += sums
        means = np.asarray(sums / np.maximum(counts, 0.5), dtype=np.float32)
        between += means * sums
        if material in (Material.METAL, Material.MASK):
            bright[material] = counts, means
    if Material.UNKNOWN in spectra.materials:
        squares = _valid(spectra, spectra.known * flipped[2])
    else:
        squares = np.full_like(total, float(np.sum(level * level)))
    np.maximum(count, 1.0, out=count)
    shared = total * total / count
    ratio = (between - shared) / np.maximum(squares - shared, 1e-3)
    # Few known cells say little.
    ratio *= count > 0.25 * weight.size
    if len(bright) == 2:
        (counts, bare), (_, mask) = bright[Material.METAL], bright[Material.MASK]
        dark = np.where(counts < 0.5, metal, bare <= mask)
        ratio *= np.where(dark, np.float32(DARK_METAL), np.float32(1.0))
    return np.asarray(ratio, dtype=np.float32)


def _flipped(spectra: Spectra, given: NDArray[np.float32]) -> NDArray[np.complex64]:
    """Return the transforms of small planes (N, rows, columns) by which fields are correlated with them."""
    from scipy import fft  # noqa: PLC0415  # as above

    # Rows first: below those given there are zeros alone, and nothing is to be transformed.
    rows = fft.rfft(given, n=spectra.size[1], axis=2)
    whole = fft.fft(rows, n=spectra.size[0], axis=1)
    return np.asarray(np.conj(whole, out=whole), dtype=np.complex64)


def _valid(spectra: Spectra, product: NDArray[np.complex64]) -> NDArray[np.float32]:
    """Return the correlation, where the window is tried, whose transform is given, which is used up."""
    from scipy import fft  # noqa: PLC0415  # as above

    (height, width), (row, column), (rows, columns) = spectra.size, spectra.corner, spectra.tried
    # Only the rows that are wanted are transformed along.
    kept = fft.ifft(product, axis=0, norm="forward", overwrite_x=True)[rows.start - row : rows.stop - row]
    found = fft.irfft(kept, n=width, axis=1, norm="forward")[:, columns.start - column : columns.stop - column]
    return np.asarray(found * np.float32(1.0 / (height * width)), dtype=np.float32)
