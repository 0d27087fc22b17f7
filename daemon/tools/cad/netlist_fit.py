"""Registration of a netlist to the layers: the shift between their origins, and the boards of a panel.

All holes and all pads vote. No shift is preferred if it explains nearly as much as the best one. Several shifts that
explain all of the netlist, each with pads of its own, are the boards of a panel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from daemon.tools.cad.apertures import turned
from daemon.tools.cad.model import Copy, Pin, Side
from daemon.tools.cad.places import SAME_PLACE_MM, Places, distinct, likely_shifts, refined, share_met, tree_of

_NEARLY = 0.97
"""A shift that explains this share of what the best one does is as good."""
_OTHER: dict[Side, Side] = {"top": "bottom", "bottom": "top"}
_ENOUGH = 0.5
"""A source of names that explains less belongs to another board."""
_SURE, _CLEARLY = 0.8, 0.2
"""A source that explains less may lie another way round, which then explains so much more, and more than this."""
_FEW = 4
"""With fewer places than this a shift is chance."""
_APART = 0.9
"""Share of the places that a scale must leave apart: a board shrunk to a dot fits any pad."""
_NOTED = 0.9
"""A side of which less fits is told."""
_FINE_MM = 0.01
"""A netlist whose places all lie this far from their pads has an origin that was rounded."""


@dataclass(frozen=True)
class Metal:
    """What a netlist can meet: holes, and pads by side (N, 2), mm."""

    holes: Places
    pads: dict[Side, Places]


@dataclass(frozen=True)
class Fit:
    """How the netlist lies on the layers. scale: its coordinates times this. share: of its records that meet metal.

    poor: of a side of which little fits, how many of the named pads have one there, and how many there are. copies:
    the boards of a panel, each by the lower left corner of its pads, the one that the netlist is for upright.
    """

    shift_mm: tuple[float, float]
    share: float
    scale: float = 1.0
    copies: tuple[Copy, ...] = ()
    named_copy: int = 0
    poor: dict[Side, tuple[int, int]] = field(default_factory=dict)


class _Cloud:
    """The netlist's places in three classes, and the trees they are held against; a side without copper has none."""

    def __init__(self, pins: Sequence[Pin], metal: Metal) -> None:
        self._pins, self._metal = pins, metal
        pads = {side: metal.pads.get(side, np.empty((0, 2))) for side in ("top", "bottom")}
        both = distinct(np.concatenate((metal.holes, pads["top"], pads["bottom"])))
        targets: dict[str, Places] = {
            "hole": both,
            **{side: places for side, places in pads.items() if side in metal.pads},
        }
        self.classes = list(targets)
        self.groups = [
            (distinct(np.array([(p.x_mm, p.y_mm) for p in pins if _class(p) == name], float).reshape(-1, 2)), target)
            for name, target in targets.items()
        ]
        self.trees = [tree_of(target) for _, target in self.groups]
        self.count = sum(len(a) for a, _ in self.groups)

    def seen(self, *, mirrored: bool, sides_swapped: bool) -> _Cloud:
        """Return the same places with x the other way, or with the names of the sides exchanged."""
        pins = [replace(p, x_mm=-p.x_mm) for p in self._pins] if mirrored else self._pins
        pads = self._metal.pads
        if sides_swapped:
            pads = {_OTHER[side]: places for side, places in pads.items()}
        return _Cloud(pins, Metal(self._metal.holes, pads))

    def share(self, shift: tuple[float, float], scale: float = 1.0, turn_deg: float = 0.0) -> float:
        """Return the share of places that meet metal when turned about the origin, then shifted."""
        met = sum(
            share_met(turned(a * scale, turn_deg) + shift, tree) * len(a)
            for (a, _), tree in zip(self.groups, self.trees, strict=True)
        )
        return met / max(self.count, 1)

    def on_sides(self, fit: Fit) -> dict[Side, tuple[Places, Places]]:
        """Return the places that are named on a side alone, as they lie on the layers, and the pads there."""
        groups = dict(zip(self.classes, self.groups, strict=True))
        return {
            side: (groups[side][0] * fit.scale + fit.shift_mm, groups[side][1])
            for side in ("top", "bottom")
            if side in groups
        }

    def stays_apart(self, scale: float) -> bool:
        """Say whether places that lie apart still do when scaled."""
        every = np.concatenate([a for a, _ in self.groups])
        before, after = (len(np.unique(np.round(every * by / SAME_PLACE_MM), axis=0)) for by in (1.0, scale))
        return after >= _APART * before

    def sample_share(self, shift: tuple[float, float], turn_deg: float) -> float:
        """Return the share of some forty places of the largest class, to a rough shift."""
        k = max(range(len(self.groups)), key=lambda n: len(self.groups[n][0]))
        some = self.groups[k][0][:: max(1, len(self.groups[k][0]) // 40)]
        return share_met(turned(some, turn_deg) + shift, self.trees[k], 2 * SAME_PLACE_MM)

    def shifts(self, scale: float = 1.0, turn_deg: float = 0.0, keep: int = 24) -> list[tuple[float, float]]:
        return likely_shifts([(turned(a * scale, turn_deg), b) for a, b in self.groups], keep)

    def met_metal(self, shift: tuple[float, float], turn_deg: float) -> set[tuple[int, int]]:
        """Return the places of the metal that is met, in cells of 0.1 mm."""
        found = np.concatenate([turned(a, turn_deg) + shift for a, _ in self.groups])
        return {(int(x), int(y)) for x, y in np.round(found * 10.0)}


def _class(pin: Pin) -> str:
    if pin.hole_mm or pin.is_via or len(pin.access) != 1:
        return "hole"
    return next(iter(pin.access))


def fit_netlist(pins: Sequence[Pin], metal: Metal, name: str, scales: Sequence[float] = (1.0,)) -> Fit:
    """Find shift, scale and copies; raise ValueError where the names belong to other layers or fit in several ways."""
    cloud = _Cloud(pins, metal)
    if not cloud.count and pins:  # all of them lie on a side of which there is no copper
        return Fit((0.0, 0.0), 1.0)
    if not cloud.count:
        raise ValueError(f"{name} names no pad; export the netlist again")
    best = _best_fit(cloud, scales)
    _require(cloud, best, name)
    best = replace(best, poor=_poor_sides(cloud, best, name))
    best = _with_copies(cloud, best, name) if best.scale == 1.0 else best
    return best if best.copies or best.shift_mm != (0.0, 0.0) else replace(best, shift_mm=_fine_shift(cloud, best))


def _best_fit(cloud: _Cloud, scales: Sequence[float]) -> Fit:
    """Return the first scale and the shift that explain most; as it lies, where that explains nearly as much."""
    best = Fit((0.0, 0.0), cloud.share((0.0, 0.0)))
    for scale in scales:
        if scale != 1.0 and best.share >= _ENOUGH and cloud.count >= _FEW:
            break
        if not cloud.stays_apart(scale):
            continue
        for shift in cloud.shifts(scale):
            share = cloud.share(shift, scale)
            if share * _NEARLY > best.share:
                found = refined(shift, [(a * scale, b) for a, b in cloud.groups]) if shift != (0.0, 0.0) else shift
                best = Fit(found, cloud.share(found, scale), scale)
    return best


def _require(cloud: _Cloud, best: Fit, name: str) -> None:
    """Raise ValueError for a fit that is none, or chance."""
    if best.share < _SURE and (how := _other_way_round(cloud, best.share)) is not None:
        raise ValueError(
            f"{name} does not lie as the layers do: it {how}; export both anew, seen from the top, with one origin"
        )
    if best.share < _ENOUGH:
        raise ValueError(
            f"{name} does not fit the layers: at best {best.share:.0%} of its {cloud.count} places have a pad or a "
            "hole; export netlist and Gerbers from the same state of the board"
        )
    if cloud.count < _FEW and best.shift_mm != (0.0, 0.0):
        raise ValueError(
            f"{name} has only {cloud.count} places, too few to find its origin; "
            "export netlist and Gerbers with one origin"
        )
    if best.share < _SURE and (best.shift_mm != (0.0, 0.0) or best.scale != 1.0):
        x, y = best.shift_mm
        raise ValueError(
            f"{name} does not fit the layers: at best, shifted by {x:.2f}, {y:.2f} mm, {best.share:.0%} of its "
            f"{cloud.count} places have a pad or a hole; export netlist and Gerbers from the same state of the board, "
            "with one origin"
        )


def _poor_sides(cloud: _Cloud, fit: Fit, name: str) -> dict[Side, tuple[int, int]]:
    """Return the sides of which little fits; raise ValueError for one that lies elsewhere than the rest."""
    poor: dict[Side, tuple[int, int]] = {}
    for side, (places, pads) in cloud.on_sides(fit).items():
        count, share = len(places), share_met(places, tree_of(pads))
        if not count or share >= _NOTED:
            continue
        how = _how_it_lies(places, pads, share) if count >= _FEW else None
        if count >= _FEW and (how or share < _ENOUGH):
            raise ValueError(
                f"{name} does not fit the {side}: {share:.0%} of the {count} pads that it names there have one"
                f"{how or ''}, of all its places {fit.share:.0%}; export netlist and Gerbers again, all seen from the "
                "top, with one origin"
            )
        poor[side] = round(share * count), count
    return poor


def _how_it_lies(places: Places, pads: Places, share: float) -> str | None:
    """Say how the places of one side fit its pads clearly better."""
    tree, least = tree_of(pads), max(_SURE, share + _CLEARLY)
    for flip in ((1.0, 1.0), (-1.0, 1.0), (1.0, -1.0)):
        flipped: Places = places * flip
        found, way = max((share_met(flipped + s, tree), s) for s in likely_shifts([(flipped, pads)]))
        if found >= least:
            return f" ({f'shifted by {way[0]:.2f}, {way[1]:.2f} mm' if flip == (1.0, 1.0) else 'mirrored'} they do)"
    return None


def _fine_shift(cloud: _Cloud, fit: Fit) -> tuple[float, float]:
    """Return the way to the pads of a netlist that fits as it lies; none where only its digits are rounded."""
    shift = refined((0.0, 0.0), [(a * fit.scale, b) for a, b in cloud.groups])
    return shift if max(abs(v) for v in shift) > _FINE_MM else (0.0, 0.0)


def _other_way_round(cloud: _Cloud, share: float) -> str | None:
    """Say how names lie that fit the layers only mirrored, turned or with their sides exchanged."""
    best, least = None, max(_SURE, share + _CLEARLY)
    if cloud.count < _FEW:
        return None
    ways = product((False, True), (False, True), (0.0, 180.0, 90.0, 270.0))
    for mirrored, swapped, turn_deg in ways:
        other = cloud.seen(mirrored=mirrored, sides_swapped=swapped)
        found = max(other.share(s, turn_deg=turn_deg) for s in other.shifts(turn_deg=turn_deg))
        if found * _NEARLY > least:  # the plainest of several
            best, least = (mirrored, swapped, turn_deg), found
    if best is None:
        return None
    mirrored, swapped, turn_deg = best
    its_turn = turn_deg if mirrored else 360.0 - turn_deg  # what was found carries it back
    told = [
        "is mirrored" if mirrored else "", f"is turned by {its_turn:g} degrees" if turn_deg else "",
        "names the top's pads as the bottom's" if swapped else "",
    ]  # fmt: skip
    return " and ".join(t for t in told if t)


# --- panels ----------------------------------------------------------------------------------------------------


def _with_copies(cloud: _Cloud, best: Fit, name: str) -> Fit:
    """Look for further places of the whole netlist: shifted, then turned."""
    poses = [(best.shift_mm, 0.0)]
    taken = cloud.met_metal(best.shift_mm, 0.0)
    if cloud.count < _FEW:
        return best
    rivals = []
    for turn_deg in (0.0, 180.0, 90.0, 270.0):
        if turn_deg and not _room_for_more(cloud, taken):
            break
        for rough in cloud.shifts(turn_deg=turn_deg, keep=60):
            if cloud.sample_share(rough, turn_deg) < 0.7 * best.share:
                continue
            shift = refined(rough, [(turned(a, turn_deg), b) for a, b in cloud.groups]) if any(rough) else rough
            if _known(shift, turn_deg, poses) or cloud.share(shift, turn_deg=turn_deg) < _NEARLY * best.share:
                continue
            mine = cloud.met_metal(shift, turn_deg)
            if len(mine & taken) > 0.1 * len(mine):
                rivals.append((shift, turn_deg))
                continue
            poses.append((shift, turn_deg))
            taken |= mine
    if len(poses) == 1 and rivals and best.shift_mm != (0.0, 0.0) and rivals[0][1] == 0.0:
        (x, y), (a, b) = best.shift_mm, rivals[0][0]
        raise ValueError(
            f"{name} fits the layers in two ways, shifted by {x:.2f}, {y:.2f} mm and by {a:.2f}, {b:.2f} mm; "
            "export netlist and Gerbers with one origin"
        )
    if len(poses) == 1:
        return best
    return _as_copies(cloud, best, poses)


def _known(shift: tuple[float, float], turn_deg: float, poses: list[tuple[tuple[float, float], float]]) -> bool:
    near = 4.0 * SAME_PLACE_MM
    return any(turn_deg == t and abs(shift[0] - x) < near and abs(shift[1] - y) < near for (x, y), t in poses)


def _room_for_more(cloud: _Cloud, taken: set[tuple[int, int]]) -> bool:
    """Say whether enough metal is unexplained for another whole board."""
    metal = {(int(x), int(y)) for _, b in cloud.groups for x, y in np.round(b * 10.0)}
    return len(metal - taken) > 0.9 * cloud.count


def _as_copies(cloud: _Cloud, best: Fit, poses: list[tuple[tuple[float, float], float]]) -> Fit:
    """Return the fit with its copies, numbered from the lower left."""
    places = np.concatenate([a for a, _ in cloud.groups])
    corner = places.min(axis=0)

    def middle(pose: tuple[tuple[float, float], float]) -> tuple[float, float]:
        x, y = turned(places.mean(axis=0)[None], pose[1])[0] + pose[0]
        return round(float(y), 1), round(float(x), 1)

    ordered = sorted(poses, key=middle)
    copies = []
    for number, (shift, turn_deg) in enumerate(ordered, 1):
        x, y = turned(corner[None], turn_deg)[0] + shift
        copies.append(Copy(str(number), round(float(x), 4), round(float(y), 4), turn_deg))
    if best.shift_mm == (0.0, 0.0):
        named = ordered.index((best.shift_mm, 0.0))
    else:  # the names are for any of the copies alike; the first upright one is as good, and always the same
        named = next(k for k, (_, turn_deg) in enumerate(ordered) if turn_deg == 0.0)
    return replace(best, shift_mm=ordered[named][0], copies=tuple(copies), named_copy=named)
