"""Fixture's truth: which pads of the board in the nest are joined to their net's pin of the harness."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from daemon.domain.board import BoardPoint
from daemon.tools.demo.processes import DemoBench
from daemon.tools.demo.true_place import same_net
from daemon.tools.demo.truth_log import Stretch

NEAR_MM = 1.0
"""Metal that is no part's pin is no farther from its point: a site on a large pad may be off its middle."""


class Fixture:
    """What the simulated station tells of one board. Asked anew for each that is laid in."""

    def __init__(self, bench: DemoBench) -> None:
        told = bench.ask("pads")
        self._side, self._outline_mm = str(told["side"]), told["outline_mm"]
        self._pads: list[Mapping[str, Any]] = told["pads"]
        circuit = bench.ask("circuit")
        self._cut_off = {(pad["net"], pad["x_mm"], pad["y_mm"]) for pad in circuit["cut_off"]}
        self._harness = set(circuit["harness"].values())

    def net_of(self, point: BoardPoint) -> str | None:
        """Return the net of the pad at a point, as the truth spells it; None: there is none of its net's."""
        pad = self._pad(point)
        return None if pad is None else str(pad["net"])

    def is_sound(self, point: BoardPoint, happened: Stretch) -> bool:
        """Tell whether a point's pad is joined to the harness: where it was touched, the log says so itself."""
        pad = self._pad(point)
        if pad is None:
            raise ValueError(f"the simulated station has no pad of {point.net} at {point.name}")
        for stroke in reversed(happened.on_board):
            if stroke.pad not in (None, pad["pin"]):
                continue  # another point of the net, touched to see whether its channel reads
            if pad["net"] in stroke.nets and len(stroke.nets) == 1 and stroke.joined == stroke.nets:
                return True
        return (pad["net"], pad["x_mm"], pad["y_mm"]) not in self._cut_off

    def _pad(self, point: BoardPoint) -> Mapping[str, Any] | None:
        """Return the pad of a point: its pin's, where the truth knows that pin, else the nearest of its net."""
        x0_mm, y0_mm, x1_mm, _ = self._outline_mm
        across_mm = point.x_um / 1e3
        place = (x0_mm + across_mm if self._side == "top" else x1_mm - across_mm, y0_mm + point.y_um / 1e3)
        wired = [pad for pad in self._pads if pad["net"] in self._harness and same_net(pad["net"], point.net)]
        # A large pad is touched so far off its middle that another pad's may be nearer.
        own = [pad for pad in wired if point.part and pad["pin"] == f"{point.part}.{point.pin}"]
        near = [(math.dist(place, (pad["x_mm"], pad["y_mm"])), k) for k, pad in enumerate(own or wired)]
        away_mm, k = min(near, default=(math.inf, -1))
        return (own or wired)[k] if own or away_mm <= NEAR_MM else None
