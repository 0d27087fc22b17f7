"""Netlist entries of one pad made one: castellated and through-hole pads come once for each side in some netlists."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from daemon.tools.cad.model import Pin

SAME_MM = 0.005


def merged(pins: Sequence[Pin]) -> tuple[Pin, ...]:
    """Return the pins with entries of the same part, pin, net and place made one, in the order they came."""
    found: dict[tuple[object, ...], Pin] = {}
    for pin in pins:
        key = (pin.part, pin.pin, pin.net, pin.is_via, round(pin.x_mm / SAME_MM), round(pin.y_mm / SAME_MM))
        known = found.get(key)
        if known is None:
            found[key] = pin
        else:
            found[key] = replace(
                known,
                access=known.access | pin.access,
                covered=(known.covered - (pin.access - pin.covered)) | (pin.covered - (known.access - known.covered)),
                hole_mm=known.hole_mm or pin.hole_mm,
                feature=known.feature or pin.feature,
            )
    return tuple(found.values())
