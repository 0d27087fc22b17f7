"""Coarse search: where in CAD the picture's neighbourhood fits, by correlation ratio over all shifts at once.

The ratio is the share of the picture's variance that lies between the means of the materials (Roche et al., 1998): it
asks that equal materials look equal, not which is how bright. Unknown cells count for nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

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
    """Fourier transforms (materials, size, ...) of the materials' planes.

    window: the cells of the picture as assumed; lags (rows, columns): how many places it is tried at.
    """

    materials: tuple[Material, ...]
    planes: NDArray[np.complex64]
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
    from scipy import fft  # noqa: PLC0415  # slow to load, see `vision.warm`

    cell = planes.grid.cell_um
    known = 1.0 - float(planes.around(*about_um, WINDOW_UM).cover[Material.UNKNOWN].mean())
    window_um = WINDOW_UM if known >= LEAST_KNOWN else LARGE_WINDOW_UM
    reach, half = round(SEARCH_UM / cell), round(window_um / cell)
    field = planes.around(*about_um, (reach + half) * cell)
    present = tuple(m for m in Material if float(field.cover[m].max()) > 0.0)
    size = int(fft.next_fast_len(2 * (reach + half), real=True))
    spectra = fft.rfft2(field.cover[list(present)], s=(size, size))
    window = planes.around(*about_um, half * cell).grid
    return Spectra(present, spectra.astype(np.complex64), size, window, 2 * reach + 1)


def transform_all(planes: Planes, window_cells: int) -> Spectra:
    """Prepare the search of a square window all over square planes."""
    from scipy import fft  # noqa: PLC0415  # as above

    present = tuple(m for m in Material if float(planes.cover[m].max()) > 0.0)
    size = int(fft.next_fast_len(planes.grid.rows, real=True))
    spectra = fft.rfft2(planes.cover[list(present)], s=(size, size))
    window = planes.grid.part(slice(0, window_cells), slice(0, window_cells))
    return Spectra(present, spectra.astype(np.complex64), size, window, planes.grid.rows - window_cells + 1)


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
    from scipy import fft  # noqa: PLC0415  # as above

    weight = seen.astype(np.float32)
    if not weight.any():
        return np.zeros((spectra.lags, spectra.lags), dtype=np.float32)
    level = np.where(seen, picture - np.float32(picture[seen].mean()), np.float32(0.0)).astype(np.float32)
    given = np.stack([weight, level, level * level])
    flipped = np.conj(fft.rfft2(given, s=(spectra.size, spectra.size)).astype(np.complex64))
    known = [k for k, m in enumerate(spectra.materials) if m is not Material.UNKNOWN]
    planes = spectra.planes[known]
    counts = _valid(spectra, planes * flipped[0])
    sums = _valid(spectra, planes * flipped[1])
    count, total = counts.sum(axis=0), sums.sum(axis=0)
    if len(known) < len(spectra.materials):
        squares = _valid(spectra, planes.sum(axis=0) * flipped[2])
    else:
        squares = np.full_like(total, float(given[2].sum()))
    count = np.maximum(count, 1.0)
    means = sums / np.maximum(counts, 0.5)
    between = (means * sums).sum(axis=0) - total * total / count
    whole = squares - total * total / count
    ratio = between / np.maximum(whole, 1e-3)
    # Few known cells say little.
    ratio *= count > 0.25 * weight.size
    names = [spectra.materials[k] for k in known]
    if Material.METAL in names and Material.MASK in names:
        bare, mask = names.index(Material.METAL), names.index(Material.MASK)
        dark = np.where(counts[bare] < 0.5, metal, means[bare] <= means[mask])
        ratio *= np.where(dark, np.float32(DARK_METAL), np.float32(1.0))
    return np.asarray(ratio, dtype=np.float32)


def _valid(spectra: Spectra, product: NDArray[np.complex64]) -> NDArray[np.float32]:
    from scipy import fft  # noqa: PLC0415  # as above

    lags = spectra.lags
    whole = fft.irfft2(product, s=(spectra.size, spectra.size))
    return np.asarray(whole[..., :lags, :lags], dtype=np.float32)
