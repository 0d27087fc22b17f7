"""Circuit of the board and its harness: what lies between the needle and the closed channels of the meter's scanner.

A net is a piece of copper that the harness reaches at one place. A broken trace cuts it: what is farther from that
place than the break hangs free. Shorts join two nets; parts, where the board is assembled, lie between nets. Each net
draws from the seed whether it is broken or shorted, and the shares decide; so a share turned up changes no other net.
What is NOT modelled: semiconductors but for the clamping diodes of chips, inductance, charge that is left, a powered
board.
"""

from __future__ import annotations

import math
import random
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np

KELVIN = 1
"""Channel of the second wire of the needle: between it and the first lies only the metal they stand on."""
FIRST_PIN = 101
"""Channel of the first net's pin; the others follow in the order of their names."""
COIN = "REFERENCE COIN"
"""Net of the coin beside the board, which is joined to the meter's return for good."""

_OHM_PER_MM = 5e-4
_SHORT_OHM = 0.05
_LEAST_OHM = 1e-4
_PF_PER_PAD = (2.0, 6.0)
_STRAY_PF = 3.0
_CLAMP_V = (0.52, 0.72)
TEST_A = 1e-3
"""Current of the diode test."""
_WHOLE_CUT = 0.3
"""Share of breaks that are at the harness' own joint, so that all of the net hangs free."""


class NetPad(Protocol):
    """A pad as a netlist has it."""

    @property
    def net(self) -> str:
        """Return its net, empty where it has none."""

    @property
    def reference(self) -> str:
        """Return its part, empty for a via."""

    @property
    def x_mm(self) -> float:
        """Return its CAD place."""

    @property
    def y_mm(self) -> float:
        """Return its CAD place."""


@dataclass(frozen=True)
class Defects:
    """Shares (0..1) of nets that are broken or shorted to a neighbour, and the harness' resistance and joined wires."""

    opens: float = 0.0
    shorts: float = 0.0
    harness_ohm: float = 0.0
    joined: frozenset[int] = frozenset()
    """Channels whose wires of the harness touch each other."""


@dataclass(frozen=True)
class Place:
    """A place on a net; a place off every net has none."""

    net: str | None
    x_mm: float = 0.0
    y_mm: float = 0.0


Node = tuple[str, bool]
"""A net, and whether it is the part that the harness reaches."""
_RETURN: Node = ("", True)


class Circuit:
    """One board on its harness."""

    def __init__(self, pads: Iterable[NetPad], seed: int | str, *, assembled: bool = False) -> None:
        self._seed = seed
        self._assembled = assembled
        self._pads: dict[str, list[NetPad]] = {}
        for pad in pads:
            if pad.net:
                self._pads.setdefault(pad.net, []).append(pad)
        self.pins: Mapping[int, str] = dict(enumerate(sorted(self._pads, key=_natural), start=FIRST_PIN))
        self._entry = {net: self._entry_of(net) for net in self._pads}
        self._parts = self._two_pin_parts() if assembled else ()

    # ------------------------------------------------------------------ what is broken

    def broken(self, defects: Defects) -> tuple[str, ...]:
        """Return the nets with a broken trace."""
        return tuple(net for net in self._pads if self._rng("open", net).random() < defects.opens)

    def cut_off(self, defects: Defects) -> list[dict[str, object]]:
        """Return the pads that a break parts from their harness' pin: net and CAD place."""
        return [
            {"net": net, "x_mm": pad.x_mm, "y_mm": pad.y_mm}
            for net in self.broken(defects)
            for pad in self._pads[net]
            if not self._node_of(pad, defects)[1]
        ]

    def shorted(self, defects: Defects) -> tuple[tuple[str, str], ...]:
        """Return the pairs of nets that are joined where they should not be."""
        found = []
        for net in self._pads:
            if self._rng("short", net).random() < defects.shorts:
                neighbour = self._neighbour(net)
                if neighbour is not None:
                    found.append((net, neighbour))
        return tuple(found)

    def node(self, place: Place, defects: Defects) -> Node | None:
        """Return which part of its net a place is on; None off every net that is known."""
        if place.net == COIN:
            return (COIN, True)
        if place.net is None or place.net not in self._pads:
            return None
        return place.net, self._away_mm(place) < self._cut_mm(place.net, defects)

    # ------------------------------------------------------------------ what is measured

    def ohms(self, places: Sequence[Place], channels: Sequence[int], defects: Defects) -> float:
        """Return the resistance from the needle, which joins these places, to the closed channels; inf: none."""
        nodes = [self.node(place, defects) for place in places]
        from_ = {node for node in nodes if node is not None}
        if not from_:
            return math.inf
        edges = self._edges(channels, defects)
        trace_ohm = min(self._away_mm(place) * _OHM_PER_MM for place in places if place.net is not None)
        return _resistance(from_, edges) + trace_ohm

    def farads(self, places: Sequence[Place], channels: Sequence[int], defects: Defects) -> float:
        """Return the capacitance from the needle to the closed channels, the parts' and the copper's own."""
        to = {self.pins[channel] for channel in channels if channel in self.pins}
        total_pf = _STRAY_PF
        for place in places:
            node = self.node(place, defects)
            if node is None or place.net == COIN:
                continue
            if any(_is_ground(net) for net in to):
                total_pf += sum(self._pad_pf(pad) for pad in self._pads[node[0]] if self._node_of(pad, defects) == node)
            for kind, value, one, other in self._parts:
                ends = self._node_of(one, defects), self._node_of(other, defects)
                far = {end[0] for end in ends if end != node}
                if kind == "C" and node in ends and far & to:
                    total_pf += value * 1e12
        return total_pf * 1e-12

    def diode_v(self, places: Sequence[Place], channels: Sequence[int], defects: Defects) -> float:
        """Return the voltage that the diode test's current needs; inf: none flows."""
        path_v = self.ohms(places, channels, defects) * TEST_A
        grounded = any(_is_ground(self.pins.get(channel, "")) for channel in channels)
        clamps = [math.inf]
        for place in places:
            node = self.node(place, defects)
            if self._assembled and grounded and node is not None and place.net in self._pads:
                chips = [pad for pad in self._pads[node[0]] if re.match(r"U\d", pad.reference)]
                if any(self._node_of(pad, defects) == node for pad in chips):
                    clamps.append(self._rng("clamp", node[0]).uniform(*_CLAMP_V))
        return min(path_v, *clamps)

    # ------------------------------------------------------------------ inside

    def _edges(self, channels: Sequence[int], defects: Defects) -> list[tuple[Node, Node, float]]:
        harness_ohm = max(defects.harness_ohm, _LEAST_OHM)
        edges = [((self.pins[n], True), _RETURN, harness_ohm) for n in channels if n in self.pins]
        edges.append(((COIN, True), _RETURN, _LEAST_OHM))
        edges += [((a, True), (b, True), _SHORT_OHM) for a, b in self.shorted(defects)]
        wires = sorted(defects.joined & set(self.pins))
        edges += [((self.pins[a], True), (self.pins[b], True), _SHORT_OHM) for a, b in pairwise(wires)]
        for kind, value, one, other in self._parts:
            if kind == "R":
                edges.append((self._node_of(one, defects), self._node_of(other, defects), value))
        return edges

    def _node_of(self, pad: NetPad, defects: Defects) -> Node:
        away_mm = math.dist((pad.x_mm, pad.y_mm), self._entry[pad.net])
        return pad.net, away_mm < self._cut_mm(pad.net, defects)

    def _away_mm(self, place: Place) -> float:
        entry = self._entry.get(place.net or "")
        return 0.0 if entry is None else math.dist((place.x_mm, place.y_mm), entry)

    def _cut_mm(self, net: str, defects: Defects) -> float:
        """Return how far from the harness' place a net is whole."""
        rng = self._rng("open", net)
        if rng.random() >= defects.opens:
            return math.inf
        aways = sorted({round(math.dist((p.x_mm, p.y_mm), self._entry[net]), 3) for p in self._pads[net]})
        if len(aways) < 2 or rng.random() < _WHOLE_CUT:
            return -1.0
        k = rng.randrange(1, len(aways))
        return (aways[k - 1] + aways[k]) / 2.0

    def _entry_of(self, net: str) -> tuple[float, float]:
        """Return where the harness reaches a net: at a connector's pin if it has one."""
        pads = self._pads[net]
        connectors = [pad for pad in pads if re.match(r"(J|P|CN|CON|X)\d", pad.reference)]
        pad = self._rng("entry", net).choice(connectors or pads)
        return pad.x_mm, pad.y_mm

    def _neighbour(self, net: str) -> str | None:
        """Return the net whose pad is nearest to one of a net's own."""
        own = np.array([(p.x_mm, p.y_mm) for p in self._pads[net]])
        best: tuple[float, str] | None = None
        for other, pads in self._pads.items():
            if other != net:
                places = np.array([(p.x_mm, p.y_mm) for p in pads])
                nearest = float(np.hypot(*(own[:, None, :] - places[None, :, :]).T).min())
                best = min(best, (nearest, other)) if best else (nearest, other)
        return best[1] if best else None

    def _two_pin_parts(self) -> tuple[tuple[str, float, NetPad, NetPad], ...]:
        parts: dict[str, list[NetPad]] = {}
        for pads in self._pads.values():
            for pad in pads:
                parts.setdefault(pad.reference, []).append(pad)
        found = []
        for name, pins in sorted(parts.items()):
            kind = next((k for pattern, k in _KINDS if re.match(pattern, name)), None)
            if kind is None or len(pins) != 2:
                continue
            low, high = _VALUES[kind[0]]
            value = math.exp(self._rng("part", name).uniform(math.log(low), math.log(high)))
            found.append((kind[1], value, pins[0], pins[1]))
        return tuple(found)

    def _pad_pf(self, pad: NetPad) -> float:
        return self._rng("pf", pad.net, pad.x_mm, pad.y_mm).uniform(*_PF_PER_PAD)

    def _rng(self, *purpose: object) -> random.Random:
        return random.Random("/".join(map(str, (self._seed, "circuit", *purpose))))


_KINDS = ((r"R\d", ("resistor", "R")), (r"C\d", ("capacitor", "C")), (r"(L|FB)\d", ("coil", "R")))
_VALUES = {"resistor": (100.0, 1e5), "capacitor": (1e-10, 1e-6), "coil": (0.05, 1.0)}


def _resistance(from_: set[Node], edges: Iterable[tuple[Node, Node, float]]) -> float:
    """Return the resistance between a set of joined nodes and the return (Kirchhoff, by the network's Laplacian)."""
    joined = [(_one(a, from_), _one(b, from_), ohm) for a, b, ohm in edges]
    start = next(iter(sorted(from_)))
    reached, edge = {start}, {start}
    while edge:
        edge = {b for a, b, _ in [*joined, *((b, a, r) for a, b, r in joined)] if a in edge} - reached
        reached |= edge
    if _RETURN not in reached:
        return math.inf
    order = {node: k for k, node in enumerate(sorted(reached - {_RETURN}))}
    laplacian = np.zeros((len(order), len(order)))
    for a, b, ohm in joined:
        for one, other in ((a, b), (b, a)):
            if one in order and a != b:
                laplacian[order[one], order[one]] += 1.0 / ohm
                if other in order:
                    laplacian[order[one], order[other]] -= 1.0 / ohm
    current = np.zeros(len(order))
    current[order[start]] = 1.0
    return float(np.linalg.solve(laplacian, current)[order[start]])


def _one(node: Node, joined: set[Node]) -> Node:
    return min(joined) if node in joined else node


def _is_ground(net: str) -> bool:
    return re.fullmatch(r"\W*(A|D|P|S)?GND\w*|VSS\w*", net, re.IGNORECASE) is not None


def _natural(name: str) -> list[tuple[int, str]]:
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name)]
