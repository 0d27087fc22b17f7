"""Kinds of frames: how the board lies and what is wrong with it, drawn by a seed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tests.bench.see.artist import Lie, Trouble
from tests.bench.see.boards import Side
from vision.registration import Target

Rng = np.random.Generator
SAME_SIZE_UM = 60.0
FAR_UM = 400.0
"""Displaced is farther than this."""


PLAIN = Trouble()


@dataclass(frozen=True)
class Kind:
    """lie: where the board is for a target. right: whether there is a right answer (else: only refusing is right).

    known_parts: CAD tells of the parts. frames_of: which side is drawn: `own`, `other` (side up), `foreign` (board).
    seated: the layers' shifts were measured when the board was laid in. at_unique: not at a pad, but at the two places
    of the side that are least like any other, which a seat looks at. fitted: parts of the board's own, standing, as the
    simulated station draws them, on both sides. alone: at any pad, soldered or not, the board alone is asked for.
    """

    lie: Callable[[Side, Target, Rng], Lie | None]
    trouble: Trouble = PLAIN
    right: bool = True
    known_parts: bool = True
    frames_of: str = "own"
    seated: bool = False
    at_unique: bool = False
    fitted: bool = False
    alone: bool = False


def _near(_side: Side, _target: Target, rng: Rng, most_um: float = 60.0) -> Lie:
    return Lie(*(float(v) for v in rng.uniform(-most_um, most_um, 2)), turn_deg=float(rng.normal(0.0, 0.1)))


def _by_vector(least_um: float, most_um: float, *, same_size: bool = True) -> Callable[[Side, Target, Rng], Lie | None]:
    """Displace the board so that another pad lies just where the target should."""

    def lie(side: Side, target: Target, rng: Rng) -> Lie | None:
        size = np.ptp(target.outline_um, axis=0)
        ways = [
            (target.x_um - other.x_um, target.y_um - other.y_um)
            for other in side.targets
            if least_um < np.hypot(target.x_um - other.x_um, target.y_um - other.y_um) < most_um
            and (not same_size or np.abs(np.ptp(other.outline_um, axis=0) - size).max() < SAME_SIZE_UM)
        ]
        if not ways:
            return None
        x_um, y_um = ways[int(rng.integers(len(ways)))]
        return Lie(float(x_um), float(y_um), turn_deg=float(rng.normal(0.0, 0.1)))

    return lie


def _turned(side: Side, target: Target, rng: Rng) -> Lie:
    near = _near(side, target, rng)
    return Lie(near.x_um, near.y_um, near.turn_deg, quarters=int(rng.choice([1, 2, 2, 3])))


_VECTOR = _by_vector(FAR_UM, 3200.0)
_FLUX = Trouble(flux=12)
_MISPRINTED = Trouble(ink_um=(130.0, -120.0), openings_um=(-35.0, 36.0))
KINDS: dict[str, Kind] = {
    "near": Kind(_near),
    "within": Kind(lambda side, target, rng: _near(side, target, rng, 2200.0)),
    "displaced": Kind(_VECTOR),
    "displaced_5mm": Kind(_by_vector(FAR_UM, 5000.0, same_size=False)),
    "turned": Kind(_turned, right=False),
    "missing": Kind(lambda *_: Lie(missing=True), right=False),
    "foreign": Kind(_near, right=False, frames_of="foreign"),
    "wrong_side": Kind(_near, right=False, frames_of="other"),
    "assembled": Kind(_near, Trouble(parts=True)),
    "assembled_displaced": Kind(_VECTOR, Trouble(parts=True)),
    "assembled_bare": Kind(_near, Trouble(parts=True), known_parts=False),
    "fitted": Kind(_near, _FLUX, fitted=True),
    "fitted_displaced": Kind(_VECTOR, _FLUX, fitted=True),
    "fitted_turned": Kind(_turned, _FLUX, right=False, fitted=True),
    "fitted_wrong_side": Kind(_near, _FLUX, right=False, frames_of="other", fitted=True),
    "fitted_foreign": Kind(_near, _FLUX, right=False, frames_of="foreign", fitted=True),
    "fitted_alone": Kind(_near, _FLUX, fitted=True, alone=True),
    "fitted_alone_displaced": Kind(_VECTOR, _FLUX, fitted=True, alone=True),
    "fitted_alone_turned": Kind(_turned, _FLUX, right=False, fitted=True, alone=True),
    "fitted_alone_wrong_side": Kind(_near, _FLUX, right=False, frames_of="other", fitted=True, alone=True),
    "fitted_alone_foreign": Kind(_near, _FLUX, right=False, frames_of="foreign", fitted=True, alone=True),
    "fitted_unfitted": Kind(_near, Trouble(flux=12, unfitted=0.3), fitted=True, alone=True),
    "fitted_none": Kind(_near, Trouble(unfitted=1.0), fitted=True, alone=True),
    "fitted_label": Kind(_near, Trouble(flux=12, label=True), fitted=True, alone=True),
    "seat_fitted": Kind(lambda side, target, rng: _near(side, target, rng, 800.0), _FLUX, at_unique=True, fitted=True),
    "seat_fitted_turned": Kind(_turned, _FLUX, right=False, at_unique=True, fitted=True),
    "seat_fitted_wrong_side": Kind(_near, _FLUX, right=False, frames_of="other", at_unique=True, fitted=True),
    "seat_fitted_foreign": Kind(_near, _FLUX, right=False, frames_of="foreign", at_unique=True, fitted=True),
    "dirt": Kind(_near, Trouble(dirt=60)),
    "dirt_displaced": Kind(_VECTOR, Trouble(dirt=60)),
    "metal_only": Kind(_VECTOR, Trouble(ink=False, covered=False)),
    "metal_only_turned": Kind(_turned, Trouble(ink=False, covered=False), right=False),
    "ink_off": Kind(_near, _MISPRINTED, seated=True),
    "ink_off_displaced": Kind(_VECTOR, _MISPRINTED, seated=True),
    "ink_off_turned": Kind(_turned, _MISPRINTED, right=False, seated=True),
    "ink_off_unseated": Kind(_near, _MISPRINTED),
    "seat_near": Kind(lambda side, target, rng: _near(side, target, rng, 800.0), at_unique=True),
    "seat_turned": Kind(_turned, right=False, at_unique=True),
    "seat_metal_only_turned": Kind(_turned, Trouble(ink=False, covered=False), right=False, at_unique=True),
    "seat_wrong_side": Kind(_near, right=False, frames_of="other", at_unique=True),
    "hasl": Kind(_near, Trouble(hasl=True)),
    "oxide": Kind(_near, Trouble(oxide=0.6)),
    "oxide_displaced": Kind(_VECTOR, Trouble(oxide=0.6)),
    "dents": Kind(_near, Trouble(dents=4)),
    "noise": Kind(_VECTOR, Trouble(noise_grey=10.0)),
    "blur": Kind(_VECTOR, Trouble(blur_px=3.0)),
    "falloff": Kind(_VECTOR, Trouble(falloff=0.5)),
    "dark": Kind(_VECTOR, Trouble(light=0.35)),
    "bright": Kind(_VECTOR, Trouble(light=1.7)),
    "tip_off": Kind(_near, Trouble(tip_px=1.0)),
    "stretched": Kind(_near, Trouble(scale=0.002)),
}
USUAL = ("near", "displaced", "turned", "missing", "wrong_side", "assembled", "dirt")
