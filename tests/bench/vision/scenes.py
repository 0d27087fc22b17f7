"""What a finder is judged on: a frame, the truth, and what it may know. Two artists draw, independently of each other.

A scene is named by (artist, kind, seed) and drawn anew from that name, so that the worst ones can be looked at again.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Frame = NDArray[np.uint8]
Point = tuple[float, float]
# As find_test_points is called by a station.
REACH_PX = 30.0
# A pick further from the truth than this would land the needle elsewhere.
RIGHT_PX = 3.0
# The share of a pad's area up to which the needle may hide it (thesis: the head looks past its own needle).
MOST_HIDDEN = 1.0 / 3.0
# Kinds carry their conditions in their name, after this mark.
MARK = " +"


@dataclass(frozen=True, eq=False)
class TipKit:
    """A needle as it is taught: a white frame before a quiet board and the end the operator clicked."""

    golden_bgr: Frame
    tip_px: Point
    angle_rad: float
    name: str


@dataclass(frozen=True, eq=False)
class TipScene:
    """A white frame. truth_px is None where there is no needle's end to find; then any answer is wrong."""

    artist: str
    kind: str
    seed: int
    hard: bool
    defect: bool
    white_bgr: Frame
    truth_px: Point | None
    kit: TipKit


@dataclass(frozen=True, eq=False)
class PadScene:
    """A red frame. truth_px is the target (the hole's centre where there is one), None in an empty scene.

    hidden: share of the pad's area behind the needle. needle_bgr: the white frame of the same needle, for those who
    ask for it (None where no needle is in view or the artist cannot draw it). flat: ratio and minor axis' direction
    (rad) of a circle as this camera always sees it, None where the view is anyone's guess.
    """

    artist: str
    kind: str
    seed: int
    hard: bool
    red_bgr: Frame
    around_px: Point
    truth_px: Point | None
    radius_px: float
    hidden: float
    needle_bgr: Frame | None = None
    kit: TipKit | None = None
    flat: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class DiscScene:
    """A red frame with one pad on plain ground, and the Cramer-Rao bound of its target (2-D, px)."""

    artist: str
    kind: str
    seed: int
    noise: float
    red_bgr: Frame
    around_px: Point
    truth_px: Point
    bound_px: float
    flat: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class MarkScene:
    """A white frame with a four-arm mark; hidden_arms are behind something."""

    artist: str
    kind: str
    seed: int
    hard: bool
    hidden_arms: int
    white_bgr: Frame
    around_px: Point
    truth_px: Point
    reach_px: float = 60.0
    arm_px: float = 60.0


class Artist(Protocol):
    """One who draws: lists its kinds and draws one by kind and seed. A kind may carry conditions (see `split`)."""

    name: str

    def tip_kinds(self) -> list[str]: ...
    def defect_kinds(self) -> list[str]: ...
    def pad_kinds(self) -> list[str]: ...
    def empty_kinds(self) -> list[str]: ...
    def disc_kinds(self) -> list[str]: ...
    def mark_kinds(self) -> list[str]: ...
    def tip(self, kind: str, seed: int) -> TipScene: ...
    def pad(self, kind: str, seed: int) -> PadScene: ...
    def disc(self, kind: str, seed: int, noise: float) -> DiscScene: ...
    def mark(self, kind: str, seed: int) -> MarkScene: ...


def join(name: str, *conditions: str) -> str:
    """Return a kind: 'site with hole +hard +needle'."""
    return name + "".join(f"{MARK}{condition}" for condition in conditions if condition)


def split(kind: str) -> tuple[str, frozenset[str]]:
    """Return a kind's name and its conditions."""
    name, *conditions = kind.split(MARK)
    return name, frozenset(conditions)


def artists(which: str) -> list[Artist]:
    """Return the artists of that name: first, second or both. ImportError where one is not there."""
    from tests.bench.vision.artist_first import FirstArtist
    from tests.bench.vision.artist_second import SecondArtist

    both: dict[str, Any] = {"first": FirstArtist, "second": SecondArtist}
    if which != "both" and which not in both:
        raise ValueError(f"the artists are first, second and both, not {which!r}")
    return [make() for name, make in both.items() if which in (name, "both")]


@dataclass(frozen=True)
class Name:
    """What a scene is drawn from; small enough to be sent to a worker."""

    task: str
    artist: str
    kind: str
    seed: int
    noise: float = 0.0


def draw(artist: Artist, name: Name) -> Any:
    """Return the scene of that name, of its task's type."""
    if name.task == "disc":
        return artist.disc(name.kind, name.seed, name.noise)
    return {"tip": artist.tip, "pads": artist.pad, "control": artist.mark}[name.task](name.kind, name.seed)


def plan(artist: Artist, task: str, scenes: int, seed: int) -> list[Name]:
    """Return the names of the scenes of one task, kinds in turn; the seeds run on from `seed`."""
    if task == "disc":
        kinds = [(kind, noise) for kind in artist.disc_kinds() for noise in (2.0, 4.0, 8.0)]
        picked = [kinds[i % len(kinds)] for i in range(scenes)]
        return [Name(task, artist.name, kind, seed + i, noise) for i, (kind, noise) in enumerate(picked)]
    extra: list[str] = []
    if task == "tip":
        good = _in_turn(artist.tip_kinds(), scenes)
        extra = _in_turn(artist.defect_kinds(), max(scenes // 5, 1))
    elif task == "pads":
        empty = max(scenes // 10, 1)
        good, extra = _in_turn(artist.pad_kinds(), scenes - empty), _in_turn(artist.empty_kinds(), empty)
    else:
        good = _in_turn(artist.mark_kinds(), scenes)
    return [Name(task, artist.name, kind, seed + i) for i, kind in enumerate(good + extra)]


def _in_turn(kinds: list[str], count: int) -> list[str]:
    """Return `count` kinds, all alike often; mixed, so that a short campaign sees every condition."""
    mixed = [kinds[i] for i in np.random.default_rng(0).permutation(len(kinds))]
    return [mixed[i % len(mixed)] for i in range(count)] if mixed else []
