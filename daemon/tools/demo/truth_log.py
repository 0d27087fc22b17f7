"""Truth log of the simulated station: strokes of the needle, readings and lamps of one stretch of time.

A stroke is one push of the pin: the first of a touch (`touch_down`), or a further one of it (`press`).
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

COIN, BRUSH = "REFERENCE COIN", "brush"
Event = Mapping[str, Any]


@dataclass(frozen=True)
class Stroke:
    """One push of the pin, with what was true of it."""

    t_s: float
    first: bool
    """Whether the needle came down for it."""
    material: str
    nets: tuple[str, ...] = ()
    """Nets whose metal carries enough of the needle's end."""
    joined: tuple[str, ...] = ()
    """Those of them whose pin of the harness is reached."""
    pad: str | None = None
    film: str | None = None
    soil_ohm: float = 0.0
    """Of film and debris, while it was pressed."""
    force_n: float = 0.0
    speed_um_s: float = 0.0
    error_um: float | None = None
    """To the middle of the nearest pad."""
    seen: bool = False
    """Whether the red lamp was switched on since the needle last came free; of a further stroke, before its touch."""

    @property
    def on_bench(self) -> bool:
        """Whether it is on the coin or the brush, and on no board."""
        return self.nets == (COIN,) or self.material == BRUSH


@dataclass
class Stretch:
    """What the log says of a stretch of time."""

    strokes: list[Stroke] = field(default_factory=list)
    scratches: int = 0
    dents: int = 0
    dragged_um: float = 0.0
    """Farthest that the needle was dragged in a touch."""
    lowest_z_um: float | None = None
    """Of the stops in it."""
    reads: int = 0

    @property
    def on_board(self) -> list[Stroke]:
        """Strokes on the board, in their order."""
        return [stroke for stroke in self.strokes if not stroke.on_bench]


class Tail:
    """Read a log on from where it was read last."""

    def __init__(self, path: Path) -> None:
        self._path, self._at = path, 0

    def take(self) -> list[Event]:
        """Return the whole lines that were written since."""
        with self._path.open("rb") as file:
            file.seek(self._at)
            data = file.read()
        whole = data[: data.rfind(b"\n") + 1]
        self._at += len(whole)
        return [json.loads(line) for line in whole.splitlines()]


def stretch(events: Iterable[Event]) -> Stretch:
    """Gather what happened."""
    found, seen_since_free, seen_before = Stretch(), False, False
    for event in events:
        match event["event"]:
            case "touch_down":
                seen_before, seen_since_free = seen_since_free, False
                found.strokes.append(_stroke(event, first=True, seen=seen_before))
            case "press":
                found.strokes.append(_stroke(event, first=False, seen=seen_before))
            case "light" if event["lamp"] == "red" and event["on"]:
                seen_since_free = True
            case "scratch":
                found.scratches += 1
            case "dent":
                found.dents += 1
            case "lift_off":
                seen_since_free = False
                found.dragged_um = max(found.dragged_um, float(event["dragged_um"]))
            case "settled":
                z_um = float(event["axes"]["z_um"])
                found.lowest_z_um = z_um if found.lowest_z_um is None else min(z_um, found.lowest_z_um)
            case "read":
                found.reads += 1
    return found


def _stroke(event: Event, *, first: bool, seen: bool) -> Stroke:
    nearest: Mapping[str, Any] = event.get("nearest_pad") or {}
    soil_ohm = float(event.get("film_ohm") or 0.0) + float(event.get("debris_ohm") or 0.0)
    return Stroke(
        float(event["t_s"]), first, str(event["material"]), _names(event["nets"]), _names(event.get("joined", ())),
        event.get("pad"), event.get("film"), soil_ohm,
        float(event["force_n"]), float(event.get("speed_um_s", 0.0)), nearest.get("error_um"), seen,
    )  # fmt: skip


def _names(found: Sequence[str]) -> tuple[str, ...]:
    return tuple(name for name in found if name)
