"""What a needle's surface looks like: turned metal under a lamp, and the black marking painted on it by hand."""

from dataclasses import dataclass

import numpy as np

from tests.vision.studio.needle_body import Array, Hits

RIM_WAVES = np.arange(2, 15)
"""A hand-painted rim wanders 2 to 14 times on its way round the needle."""


@dataclass(frozen=True)
class Marking:
    """A painted band between two heights; ``lower`` and ``upper`` are how its rims wander, as made by `rim`.

    ``cover`` is how black the paint still is (1: fresh, 0: gone), ``flaked`` the share of it that has come off.
    """

    low: float
    high: float
    lower: Array
    upper: Array
    cover: float = 1.0
    flaked: float = 0.0


@dataclass(frozen=True)
class Lamp:
    """A lamp as the needle mirrors it: where round the needle (rad), how bright (grey levels) and how wide (rad)."""

    azimuth: float
    shine: float
    width: float


@dataclass(frozen=True)
class Metal:
    """Finish of the needle: base grey level, lamps, depth of its turning marks and the seed of its grain."""

    base: float
    lamps: tuple[Lamp, ...]
    rings: float
    grain_seed: int


def rim(rng: np.random.Generator, rms_px: float) -> Array:
    """Return how a rim wanders, (14, 2): wave amplitudes, then the shift that makes the mean of the seen side zero."""
    waves = rng.standard_normal((RIM_WAVES.size, 2)) / np.sqrt(RIM_WAVES)[:, None]
    waves *= rms_px / max(float(np.sqrt((waves**2).sum() / 2)), 1e-9)
    seen = np.linspace(-0.9, 0.9, 181)
    return np.vstack([waves, [float(-_wander(waves, seen).mean()), 0.0]])


def shade(hits: Hits, metal: Metal, marking: Marking | None) -> Array:
    """Return the grey level (P, K) that the camera sees where the rays met the needle."""
    bare = _bare(hits, metal)
    if marking is None:
        return bare
    share = marking.cover * _painted(hits, marking, metal.grain_seed)
    paint = 8.0 + 0.06 * bare
    return bare + share * (paint - bare)


def _bare(hits: Hits, metal: Metal) -> Array:
    nx, ny, nz = hits.normal
    # Metal mirrors its surroundings: a bright room above and to the left, the dark board below, the camera in front.
    level = metal.base * (0.80 - 0.20 * ny - 0.15 * nx - 0.12 * np.clip(-nz, 0.0, 1.0))
    for lamp in metal.lamps:
        off = (hits.azimuth - lamp.azimuth) / lamp.width
        # Turning marks run round the needle and spread a lamp's image along it: a stripe, weaker where it leans away.
        level = level + lamp.shine * np.exp(-0.5 * off**2) * np.exp(-0.5 * (hits.lean / 0.45) ** 2)
    turned = 1.0 + metal.rings * (np.sin(2.1 * hits.height) * 0.6 + np.sin(0.83 * hits.height + 1.3) * 0.7)
    return level * turned * (1.0 + 0.04 * _grain(hits, metal.grain_seed, 256, 0.35))


def _painted(hits: Hits, marking: Marking, seed: int) -> Array:
    low = marking.low + _rim_at(marking.lower, hits.azimuth)
    high = marking.high + _rim_at(marking.upper, hits.azimuth)
    inside = (hits.height > low) & (hits.height < high)
    if marking.flaked <= 0:
        return inside.astype(np.float64)
    flakes = _grain(hits, seed + 1, 128, 0.3, smooth=True)
    return (inside & (flakes > _level_with_share_below(marking.flaked))).astype(np.float64)


def _rim_at(rim_shape: Array, azimuth: Array) -> Array:
    # A table is faster than 26 cosines a ray and finer than a ray's width.
    table = np.linspace(-np.pi, np.pi, 721)
    wander = _wander(rim_shape[:-1], table) + rim_shape[-1, 0]
    return np.interp(azimuth, table, wander)


def _wander(waves: Array, azimuth: Array) -> Array:
    phase = RIM_WAVES[:, None] * azimuth
    return np.asarray(waves[:, 0] @ np.cos(phase) + waves[:, 1] @ np.sin(phase))


def _grain(hits: Hits, seed: int, size: int, per_px: float, *, smooth: bool = False) -> Array:
    """Return a texture that sticks to the surface, with mean 0 and unit variance."""
    table = np.random.default_rng(seed).standard_normal((size, size))
    if smooth:
        near = sum(np.roll(table, (i, j), (0, 1)) for i in range(3) for j in range(3))
        table = np.asarray(near) / 3.0
    rows = (hits.height * per_px * (1.0 if smooth else 3.0)).astype(np.intp) % size
    cols = (hits.azimuth * 20.0 * per_px).astype(np.intp) % size
    return table[rows, cols]


def _level_with_share_below(share: float) -> float:
    levels = np.random.default_rng(0).standard_normal(4001)
    return float(np.quantile(levels, min(max(share, 0.0), 1.0)))
