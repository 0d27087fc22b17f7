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
    """Fourier transforms (materials, size, ...) of the materials' planes, `known` of all but the unknown together.

    window: the cells of the picture as assumed; lags (rows, columns): how many places it is tried at.
    """

    materials: tuple[Material, ...]
    planes: NDArray[np.complex64]
    known: NDArray[np.complex64]
    size: int
    window: Grid
    lags: int


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
    return _transformed(field, 2 * (reach + half), planes.around(*about_um, half * cell).grid, 2 * reach + 1)


def transform_all(planes: Planes, window_cells: int) -> Spectra:
    """Prepare the search of a square window all over square planes."""
    window = planes.grid.part(slice(0, window_cells), slice(0, window_cells))
    return _transformed(planes, planes.grid.rows, window, planes.grid.rows - window_cells + 1)


def for_window(spectra: Spectra, window_cells: int) -> Spectra:
    """Return what `transform_all` does for a window of another size, by the transforms that there are."""
    grid = spectra.window
    lags = spectra.lags + grid.rows - window_cells
    return replace(spectra, window=grid.part(slice(0, window_cells), slice(0, window_cells)), lags=lags)


def _transformed(field: Planes, cells: int, window: Grid, lags: int) -> Spectra:
    from scipy import fft  # noqa: PLC0415  # slow to load, see `vision.warm`

    present = tuple(m for m in Material if float(field.cover[m].max()) > 0.0)
    size = int(fft.next_fast_len(cells, real=True))
    spectra = np.empty((len(present), size, size // 2 + 1), dtype=np.complex64)
    for k, material in enumerate(present):
        spectra[k] = fft.rfft2(field.cover[material], s=(size, size))
    known = spectra[[k for k, m in enumerate(present) if m is not Material.UNKNOWN]].sum(axis=0)
    return Spectra(present, spectra, known, size, window, lags)


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
    weight = seen.astype(np.float32)
    count, total, between = (np.zeros((spectra.lags, spectra.lags), dtype=np.float32) for _ in range(3))
    if not weight.any():
        return count
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
    rows = fft.rfft(given, n=spectra.size, axis=2)
    whole = fft.fft(rows, n=spectra.size, axis=1)
    return np.asarray(np.conj(whole, out=whole), dtype=np.complex64)


def _valid(spectra: Spectra, product: NDArray[np.complex64]) -> NDArray[np.float32]:
    """Return the correlation (lags, lags) whose transform is given, which is used up."""
    from scipy import fft  # noqa: PLC0415  # as above

    lags, size = spectra.lags, spectra.size
    # Only the rows that are wanted are transformed along.
    rows = fft.ifft(product, axis=0, norm="forward", overwrite_x=True)[:lags]
    found = fft.irfft(rows, n=size, axis=1, norm="forward")[:, :lags]
    return np.asarray(found * np.float32(1.0 / size**2), dtype=np.float32)
