"""Names of what decides about an object: the rules, and what is seen only when objects are compared."""

from __future__ import annotations

from enum import StrEnum


class RuleName(StrEnum):
    """Name what decided; the values go over the wire and into records, so they stay."""

    SMALL = "small"
    FAINT = "faint"
    THIN = "thin"
    BORDER = "border"
    NEEDLE = "needle"
    WRONG_SIZE = "wrong_size"
    STROKE_END = "stroke_end"
    OVAL = "oval"
    CORNERED = "cornered"
    VIA_WITH_HOLE = "via_with_hole"
    VIA_FILLED = "via_filled"
    SITE_WITH_HOLE = "site_with_hole"
    SITE_FILLED = "site_filled"
    ELONGATED = "elongated"
    ANGULAR = "angular"
    OTHER_SIZE = "other_size"
    RAGGED = "ragged"
    NO_RULE = "no_rule"
    """Every rule passed."""
    DRAWN_RING = "drawn_ring"
    """Left undecided: a ring round bare board, half hidden or as bright as the lettering beside it."""
    DRAWN_DOT = "drawn_dot"
    """Left undecided: a disc without a hole, as even and as bright as the lettering beside it."""
    OVERLAPPING = "overlapping"
    """Left undecided: it was taken, and so was something that overlaps it."""
    OVERLAPPED = "overlapped"
    """Thrown: it lies within a better seen pad."""
    TRACE_OF_PAD = "trace_of_pad"
    """Thrown: it lies on a pad with a hole and has none itself."""
    AT_KNOWN_PLACE = "at_known_place"
    """Undecided by its looks, taken because a pad is known to lie there."""
