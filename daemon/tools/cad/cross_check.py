"""Cross-check of the netlist's names against the copper's X2 attributes: cut names written out, other names refused.

A netlist cuts parts at 6 characters and nets at 14 (KiCad keeps the last ones, in capitals); the attributes are whole.
Where the two name pads differently they come from two states of the board, and every net would be in doubt; where
they do so for a pad or two, its net is.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from scipy.spatial import KDTree

from daemon.tools.cad.model import Pin, Shape, Side, is_no_net
from daemon.tools.cad.pins import middle, named_pads, net_name, unescaped
from daemon.tools.cad.places import SAME_PLACE_MM

_FEW, _SHARE = 2, 0.03
"""More differing names than this (of all compared) are no dialect."""


def complete_names(
    pins: Sequence[Pin], copper: dict[Side, Sequence[Shape]], source: str
) -> tuple[list[Pin], list[str]]:
    """Write out names that the netlist cut; return the pins and what to tell; raise ValueError where names differ."""
    completed: list[Pin] = []
    others: list[str] = []
    compared = 0
    for pin, here in zip(pins, _names_at(pins, copper), strict=True):
        match = next((s for s in here if _same_pad(pin, s)), None)
        completed.append(_completed(pin, match) if match is not None else pin)
        if pin.part and here:
            compared += 1
            if match is None or not _agree(pin.net, match.net or ""):
                completed[-1] = replace(completed[-1], net="")  # of two nets none is sure
                other = match or here[0]
                others.append(
                    f"{pin.part}.{pin.pin} {pin.net or 'no net'} / {other.part}.{other.pin} {other.net or 'no net'}"
                )
    if len(others) > max(_FEW, _SHARE * compared):
        raise ValueError(
            f"{source} and the copper's X2 attributes name {len(others)} of {compared} pads differently "
            f"({others[0]}): export both from the same state of the board"
        )
    told = (
        f"{source} and the copper's X2 attributes name {len(others)} pads differently, whose nets are left open: "
        f"{'; '.join(others)}"
    )
    return completed, [told] if others else []


def renamed(pins: Sequence[Pin], copper: dict[Side, Sequence[Shape]]) -> list[Pin]:
    """Return the pins with the nets that the copper names where they lie: each board of a panel may have its own."""
    result = []
    for pin, here in zip(pins, _names_at(pins, copper), strict=True):
        match = next((s for s in here if _same_pad(pin, s)), None)
        result.append(replace(pin, net=net_name(match.net)) if match is not None else pin)
    return result


def _names_at(pins: Sequence[Pin], copper: dict[Side, Sequence[Shape]]) -> list[list[Shape]]:
    """Return the named pads of the copper that lie where each pin lies."""
    said = [s for side in copper.values() for s in named_pads(side)]
    if not said:
        return [[] for _ in pins]
    tree = KDTree([s.place_mm or middle(s) for s in said])
    return [[said[k] for k in tree.query_ball_point((p.x_mm, p.y_mm), SAME_PLACE_MM)] for p in pins]


def _same_pad(pin: Pin, shape: Shape) -> bool:
    """Say whether the copper's attributes may mean this pin; a via has no part."""
    part, number = shape.part or "", shape.pin or ""
    if not pin.part:
        return not part
    if not part or not part.upper().startswith(pin.part.upper()):
        return False
    return not pin.pin or not number or number.upper().startswith(pin.pin.upper())


def _completed(pin: Pin, shape: Shape) -> Pin:
    part, number, net = shape.part or "", shape.pin or "", shape.net or ""
    return replace(
        pin,
        part=part if pin.part and len(part) > len(pin.part) else pin.part,
        pin=number if pin.pin and len(number) > len(pin.pin) else pin.pin,
        net=unescaped(net) if pin.net and not is_no_net(net) and _agree(pin.net, net) else pin.net,
    )


def _agree(cut: str, whole: str) -> bool:
    """Say whether a netlist's net may be the other one; no net is no contradiction.

    It may be cut at its end or at its start, in capitals, with other signs, or numbered (`{12}`) as LibrePCB does.
    """
    if not cut or is_no_net(whole) or whole.startswith("unconnected-"):
        return True
    short = _letters(re.sub(r"\{\d+\}$", "", cut))
    return any(long.startswith(short) or long.endswith(short) for long in (_letters(whole), _letters(unescaped(whole))))


def _letters(name: str) -> str:
    return re.sub(r"[^A-Z0-9]", "", name.upper()) or name
