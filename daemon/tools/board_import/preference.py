"""Order in which the points of a net are preferred: what is made to be touched first, a connector's contacts last."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence
from enum import IntEnum

from daemon.domain.board import BoardPoint
from daemon.tools.board_import.names import is_connector
from daemon.tools.board_import.targets import ENOUGH_ROOM_UM


class Class(IntEnum):
    """Classes of points, the best first."""

    TEST_POINT = 0
    LONE = 1
    RING = 2
    LAND = 3
    PAD = 4
    VIA_IN_PAD = 5
    CONNECTOR = 6


def class_of(point: BoardPoint, *, test_point: bool, single: bool, in_pad: bool) -> Class:
    """Sort a point that may be touched. single: its part has one pin; in_pad: a via in the pad of a part."""
    if test_point:
        return Class.TEST_POINT
    if point.kind == "via":
        return Class.VIA_IN_PAD if in_pad else Class.LONE
    if point.part is None or single:
        return Class.LONE if point.shape == "round" else Class.LAND
    if point.kind == "pin":
        return Class.RING
    return Class.CONNECTOR if is_connector(point.part) else Class.PAD


def ranked(points: Sequence[BoardPoint], classes: Sequence[Class | None]) -> tuple[BoardPoint, ...]:
    """Return the points with their ranks, in the order they came."""
    nets: defaultdict[str, list[int]] = defaultdict(list)
    for i, (point, kind) in enumerate(zip(points, classes, strict=True)):
        if kind is not None:
            nets[point.net or f"/{point.name}"].append(i)
    ranks: dict[int, int] = {}
    for members in nets.values():
        members.sort(
            key=lambda i: (classes[i], -min(points[i].room_um or 0.0, ENOUGH_ROOM_UM), natural(points[i].name))
        )
        ranks |= {i: rank for rank, i in enumerate(members)}
    return tuple(p.model_copy(update={"rank": ranks[i]}) if i in ranks else p for i, p in enumerate(points))


def natural(name: str) -> list[tuple[int, str]]:
    """Return a key by which TP2 comes before TP10."""
    return [(int(s), "") if s.isdigit() else (-1, s) for s in re.split(r"(\d+)", name)]
