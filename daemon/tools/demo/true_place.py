"""True place of the needle: over what of the board it is, by the simulated station's truth."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from daemon.domain.board import BoardPoint
from daemon.domain.board_layers import as_points
from daemon.domain.results import JobResult
from daemon.tools.demo.processes import DemoBench

IPC_NAME = 14
"""Letters that IPC-D-356 has for a net's name."""


@dataclass(frozen=True)
class Touched:
    """What is under the needle's end; on metal with its net and pin, where the board's files name them."""

    what: str
    net: str | None
    pin: str | None

    @property
    def on_metal(self) -> bool:
        """Whether the needle is over metal, or over the hole in it."""
        return self.what in ("metal", "hole", "lead")

    def __str__(self) -> str:
        """Return it in words."""
        return " ".join(filter(None, (self.pin, self.net and f"({self.net})"))) if self.on_metal else self.what

    def is_of(self, point: BoardPoint) -> bool:
        """Whether this is metal of the point's net; where the files name no net, any metal."""
        return self.on_metal and (point.net is None or self.net is None or same_net(self.net, point.net))


def same_net(one: str | None, other: str | None) -> bool:
    """Tell whether two names are one net's: IPC-D-356 cuts names to 14 letters, at either end, and shouts them."""
    short, long = sorted(((one or "").upper(), (other or "").upper()), key=len)
    return short == long or (len(short) >= IPC_NAME and (long.startswith(short) or long.endswith(short)))


def off_um(point: BoardPoint, result: JobResult, board_um: tuple[float, float]) -> float:
    """Return how far a place is from where the needle belongs on a pad: the site the daemon chose, if on that pad.

    What the daemon says of its site is believed no farther than the pad's own metal in the board file goes.
    """
    target = result.detail.get("target_um")
    if isinstance(target, list | tuple) and len(target) == 2:
        x_um, y_um = float(target[0]), float(target[1])
        if _on_own_metal(point, x_um, y_um):
            return math.dist(board_um, (x_um, y_um))
    return math.dist(board_um, point.place_um)


def _on_own_metal(point: BoardPoint, x_um: float, y_um: float) -> bool:
    outlines = [as_points(outline).astype(np.float32)[:, None, :] for outline in point.metal_um]
    return any(cv2.pointPolygonTest(outline, (x_um, y_um), measureDist=False) >= 0 for outline in outlines)


def touched_by(bench: DemoBench) -> Touched:
    """Ask the truth what is under the needle."""
    on: dict[str, Any] = bench.ask("truth").get("on", {})
    what = str(on.get("what", "unknown"))
    hole_in_metal = what == "hole" and "metal" in on.get("touches", ())
    named = what in ("metal", "lead") or hole_in_metal
    return Touched(what, on.get("net") if named else None, on.get("pin") if named else None)
