"""Comparison of objects that the rules decided one by one: what one of them says of another.

Pads never lie on each other, a rectangle holds no round pad, and ink of one print is equally bright. So what was taken
may be left undecided, and what was taken or undecided may be thrown; nothing is taken here.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vision.pads.lettering import MayBeInk
from vision.pads.rule_name import RuleName
from vision.pads.rules import LEAST_VISIBLE, WHOLE_VISIBLE, Decided, SeenObject, Verdict, is_round

INK_RULES = frozenset({RuleName.THIN, RuleName.ELONGATED, RuleName.RAGGED, RuleName.STROKE_END, RuleName.OVAL})
"""What these rules throw may be ink, and ink of one print is equally bright to this share of its contrast."""
INK_LIKENESS = 0.2
OVERLAP_SHARE, EXPLAINED_SHARE = 0.8, 0.55
"""Two pads whose centres are nearer than this share of the sum of their radii would lie on each other. A doubtful one
is explained by a pad only if it lies within it."""


def apart(decided: list[Decided]) -> list[Decided]:
    """Throw a circle that lies in a better seen one that was taken; leave undecided two that only overlap.

    Pads may touch, but never lie on each other: one of the two is not what it seems, or both are ends of one oblong.
    If one of them is drilled, the other is the trace that shows in the same opening of the mask.
    """
    decided = _traces_thrown(decided)
    kept: list[Decided] = []
    for item in sorted(decided, key=lambda item: (item.verdict is not Verdict.TAKE, -_trust(item))):
        taken = [other for other in kept if other.verdict is Verdict.TAKE]
        if item.verdict is not Verdict.THROW and any(_overlap(item, other, EXPLAINED_SHARE) for other in taken):
            kept.append(replace(item, verdict=Verdict.THROW, rule=RuleName.OVERLAPPED))
        else:
            kept.append(item)
    standing = [item for item in kept if item.verdict is not Verdict.THROW and item.object.circle is not None]

    def judged(item: Decided) -> Decided:
        alone = not any(other is not item and _overlap(item, other, OVERLAP_SHARE) for other in standing)
        return (
            item
            if item.verdict is not Verdict.TAKE or alone
            else replace(item, verdict=Verdict.PASS, rule=RuleName.OVERLAPPING)
        )

    return [judged(item) for item in kept]


def _traces_thrown(decided: list[Decided]) -> list[Decided]:
    """Throw what lies on a pad with a hole in its middle, and has none itself though its own middle shows."""
    drilled = [item for item in decided if item.verdict is not Verdict.THROW and is_drilled(item.object)]

    def judged(item: Decided) -> Decided:
        seen, circle = item.object, item.object.circle
        if item.verdict is Verdict.THROW or circle is None or seen.dark_middle or circle.visible < LEAST_VISIBLE:
            return item
        on_pad = any(_overlap(item, pad, OVERLAP_SHARE) for pad in drilled)
        return replace(item, verdict=Verdict.THROW, rule=RuleName.TRACE_OF_PAD) if on_pad else item

    return [judged(item) for item in decided]


def is_drilled(seen: SeenObject) -> bool:
    """Tell whether an object is round and has a hole in its middle. A drawn ring has none: the board shows in it."""
    return seen.dark_middle and not seen.ring and is_round(seen)


def angular_after_all(decided: list[Decided], regions: list[Decided]) -> list[Decided]:
    """Throw a doubtful circle that is only what fits into a rectangle: the region it lies in was thrown as one."""
    rectangles = [item for item in regions if item.rule == RuleName.ANGULAR]

    def judged(item: Decided) -> Decided:
        circle = item.object.circle
        if item.verdict is not Verdict.PASS or circle is None:
            return item
        lies_in = any(
            np.hypot(box.object.x_px - item.object.x_px, box.object.y_px - item.object.y_px) < 0.5 * circle.radius_px
            and box.object.thickness_px > 1.2 * circle.radius_px
            for box in rectangles
        )
        return replace(item, verdict=Verdict.THROW, rule=RuleName.ANGULAR) if lies_in else item

    return [judged(item) for item in decided]


def drawn_after_all(decided: list[Decided], regions: list[Decided], may_be_ink: MayBeInk) -> list[Decided]:
    """Leave undecided what may be ink: a ring round bare board; a disc as even and bright as the lettering round it."""
    ink = [item.object.level for item in (*regions, *decided) if item.rule in INK_RULES]
    usual = float(np.median(ink)) if ink else -np.inf

    def judged(item: Decided) -> Decided:
        seen, circle = item.object, item.object.circle
        if item.verdict is not Verdict.TAKE or circle is None:
            return item
        if seen.ring:
            alike = abs(usual - seen.level) < INK_LIKENESS * seen.contrast
            doubtful = circle.visible < WHOLE_VISIBLE or alike
            return replace(item, verdict=Verdict.PASS, rule=RuleName.DRAWN_RING) if doubtful else item
        return replace(item, verdict=Verdict.PASS, rule=RuleName.DRAWN_DOT) if may_be_ink(seen) else item

    return [judged(item) for item in decided]


def _trust(item: Decided) -> float:
    circle = item.object.circle
    return 0.0 if circle is None else circle.coverage * circle.visible


def _overlap(item: Decided, other: Decided, share: float) -> bool:
    one, two = item.object, other.object
    if one.circle is None or two.circle is None:
        return False
    reach = share * (one.circle.radius_px + two.circle.radius_px)
    # Seen obliquely, touching pads are nearer in the image along the minor axis: the share leaves room for that.
    return float(np.hypot(one.x_px - two.x_px, one.y_px - two.y_px)) < reach


def is_inside(x_px: float, y_px: float, decided: list[Decided]) -> bool:
    """Tell whether a point lies in a circle that is already listed (a region is then the same thing once more)."""
    circles = [item.object for item in decided if item.object.circle is not None]
    return any(np.hypot(seen.x_px - x_px, seen.y_px - y_px) < 0.5 * seen.length_px for seen in circles)
