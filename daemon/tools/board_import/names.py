"""Names of points: unique, the same at every import and from both sides.

A test point is called as its part (`TP7`), a pin as part and pin (`U1.4`), a via by its number in the netlist
(`VIA12`). A name that comes again gets `/2`, `/3`: netlists cut names (`TP_VIN` twice) and some pins have several pads.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Sequence

from daemon.tools.cad.model import Pin, is_no_net

_TEST_POINT = re.compile(r"TP(\d+|_\w+)\Z", re.IGNORECASE)
_FIDUCIAL = re.compile(r"FID(UCIAL)?_?\d*\Z", re.IGNORECASE)
_CONNECTOR = re.compile(r"(J|P|X|CN|CON|USB|H|JP)_?\d+\Z", re.IGNORECASE)


def net_of(pin: Pin) -> str | None:
    """Return the net of a pin, None where it has none."""
    return None if is_no_net(pin.net) else pin.net


def is_connector(part: str) -> bool:
    """Whether a part is called as connectors are, whose surface is the contact of a product."""
    return _CONNECTOR.match(part) is not None


class PinRoles:
    """Which parts of a netlist are test points and fiducials, and which have pins."""

    def __init__(self, pins: Sequence[Pin]) -> None:
        numbers: defaultdict[str, set[str]] = defaultdict(set)
        for pin in pins:
            numbers[pin.part].add(pin.pin)
        self._single = {part for part, found in numbers.items() if len(found) == 1}

    def is_test_point(self, pin: Pin) -> bool:
        """Whether it is a test point: marked as one, or a part called `TP7` or `TP_VIN` that has one pin alone."""
        if pin.feature == "test_point":
            return True
        return not pin.is_via and pin.part in self._single and _TEST_POINT.match(pin.part) is not None

    def is_fiducial(self, pin: Pin) -> bool:
        """Whether it is a fiducial: marked as one, or a part called `FID2` that has one pin alone."""
        if pin.feature == "fiducial":
            return True
        return not pin.is_via and pin.part in self._single and _FIDUCIAL.match(pin.part) is not None


def name_pins(pins: Sequence[Pin], roles: PinRoles) -> list[str]:
    """Return a name for each pin, in order; no two alike."""
    counted: Counter[str] = Counter()
    vias = 0
    given: list[str] = []
    for pin in pins:
        if pin.is_via or not pin.part:
            vias += 1
            wanted = f"VIA{vias}"
        elif roles.is_test_point(pin) or roles.is_fiducial(pin):
            wanted = pin.part
        else:
            counted[pin.part] += 1
            wanted = f"{pin.part}.{pin.pin or counted[pin.part]}"
        given.append(wanted)
    return unique(given)


def unique(names: Sequence[str]) -> list[str]:
    """Return the names with `/2`, `/3`... behind those that came before."""
    taken = set(names)
    seen: set[str] = set()
    result: list[str] = []
    for name in names:
        number, free = 1, name
        while free in seen or (number > 1 and free in taken):
            number += 1
            free = f"{name}/{number}"
        seen.add(free)
        result.append(free)
    return result
