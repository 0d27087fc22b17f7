"""Full names of nets and pins: IPC-D-356 cuts and shouts them, the copper layer's X2 attributes do not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace

from sim_hw.board.nearest import Nearest
from sim_hw.board.netlist import Record

_SAME_PLACE_MM = 0.02


def fully_named(records: Iterable[Record], told: Iterable[Record]) -> tuple[Record, ...]:
    """Return a netlist's records under the names that `told` (X2 pads) gives the pads at the same places.

    A net that is known at one of its pads is known at all, vias too.
    """
    records, told = tuple(records), tuple(told)
    told_at = Nearest((pad.x_mm, pad.y_mm) for pad in told)
    pads: dict[int, Record] = {}
    nets: dict[str, Counter[str]] = {}
    for k, record in enumerate(records):
        near = told_at.within(record.x_mm, record.y_mm, _SAME_PLACE_MM)
        if near and not record.is_via:
            pads[k] = told[near[0]]
            nets.setdefault(record.net, Counter())[told[near[0]].net] += 1
    full = {net: counts.most_common(1)[0][0] for net, counts in nets.items() if net}
    return tuple(_named(record, pads.get(k), full) for k, record in enumerate(records))


def _named(record: Record, pad: Record | None, full: dict[str, str]) -> Record:
    net = full.get(record.net) or record.net
    if pad is None:
        return replace(record, net=net)
    return replace(record, net=pad.net or net, reference=pad.reference, pin=pad.pin)
