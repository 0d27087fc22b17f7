"""Ordered rules that take, throw or pass an object: which bright things are test points (thesis 5.4).

A rule is a small function from an object and what is wanted to TAKE, THROW or PASS. `decide` asks the rules in order
and ends with the first TAKE or THROW; that verdict and the rule's name stay with the object. An object that every rule
passes is undecided. There are no scores. This is the verdict on one object alone: `comparison` then compares the
objects, and may leave undecided or throw what a rule took, and throw what was undecided. It never takes.
To teach the station a new kind of pad, add a function, its name in `RuleName` and its line in `NAMES`; no other rule is
touched.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

from vision.core import CircleFit
from vision.pads.rule_name import RuleName

VIA_RADIUS_PX = (5.0, 8.0)
"""Thesis 5.4.2 and 5.4.3, px. A measured radius may differ by the slack at either end."""
SITE_RADIUS_PX = (14.0, 21.0)
CLASS_SLACK_PX = 0.5
HIDDEN_SLACK_PX = 0.5
"""Of a partly hidden one it is known this much worse."""
LEAST_AREA_PX = 20.0
"""Thesis 5.4.2 step 5."""
THIN_RATIO = 5.0
"""Thesis 5.4.2 step 4. Its other limit, under 2 px wide and over 10 px long, lies within the ratio."""
EXPECTED_SHARE, EXPECTED_SLACK_PX = 0.12, 1.0
"""A CAD radius is met within this share (but at least this many px)."""
FAINT_CONTRAST = 35.0
"""Less than this above its surroundings is a trace under the mask, not metal."""
COVERED_SHARE, MOST_COVERED = 0.85, 55.0
"""Copper under the mask is brighter than the mask by up to this share of it, and by no more levels than that."""
ON_METAL_SHARE = 0.4
"""Of a highlight on metal the surroundings lie above the board by this share of its own level above the board."""
ROUND_COVERAGE, HIDDEN_COVERAGE, LEAST_VISIBLE = 0.67, 0.72, 0.50
"""A contour is a circle if edges lie on this share of what is visible of it, more if part of it is hidden, and enough
of it is visible."""
LEAST_RATIO, DOUBTFUL_RATIO, OVAL_RATIO, WHOLE_SHAPE = 0.75, 0.785, 0.70, 0.75
"""A circle seen by a camera tilted by up to 38 degrees, and itself a little oval, is no more oval than this (minor over
major axis), and where part of its contour is missing not even so; what is clearly more oval is none, if this share of
it is visible."""
CLEAR_COVERAGE, CLEAR_NECK = 0.9, 0.4
"""What the others' brightness is held against is round all over and stands alone."""
MOST_SQUARE, SQUARE_NOISE_PX = 0.045, 0.05
"""A square of rounded corners has a fourth harmonic of 0.05 to 0.08 of its radius; ragged discs have less."""
CORNERED, CORNERED_NOISE_PX = 0.06, 0.1
MOST_NOISE = 0.25
"""Residual noise of a disc over its step: what is noisier is drawn by chance."""
DULL_SHARE, DULL_CONTRAST_SHARE = 0.55, 0.75
"""Metal much duller than the brightest round thing beside it may be silkscreen: not taken, not thrown. A circle of
which part is hidden must stand out as the brightest does: a stroke of silkscreen cut off by the probe looks like
one."""
DULL_STROKE_SHARE = 0.8
WHOLE_VISIBLE = 0.9
ANGULAR_FILL = 0.84
"""A disc fills 0.785 of the smallest rectangle round it; what fills more than this is one."""
STROKE_NECK = 0.86
"""What goes on beyond a circle as wide as this share of its diameter is a stroke of which the circle is only the end; a
trace is narrower than its pad, and a touching pad narrows to nothing where they meet."""
WIDEST_TRACE = 0.74
"""Between this and that it may be either, so it is not taken."""
PROBE_SHARE = 0.6
"""Of an object that is the probe, at least this share lies where one may be."""
LEAST_FILL = 0.75
"""Of a taken pad, hole aside, at least this share is bright."""


class Verdict(StrEnum):
    """Say what a rule thinks of an object."""

    TAKE = "take"
    THROW = "throw"
    PASS = "pass"  # noqa: S105 -- to let pass, not a password


@dataclass(frozen=True, slots=True)
class Hole:
    """Hold a dark hole in a pad: centre, radius (semi-major), 1-sigma of each coordinate of the centre, px."""

    x_px: float
    y_px: float
    radius_px: float
    sigma_px: float


@dataclass(frozen=True, slots=True)
class SeenObject:
    """Hold the features of one bright object; lengths on the board's plane in semi-major px.

    length_px, thickness_px: sides of the smallest rectangle round it. circularity: Heywood's, perimeter over that of a
    disc of the same area (1 = round). boxed: share of that rectangle it fills. fill: bright share of its circle.
    level, contrast: its median brightness, and that above its surroundings. neck: width of the widest bright thing that
    goes on beyond its circle, over the circle's diameter (0 = nothing). in_needle: share of it where an unknown probe
    may be. ring: its hole is wide and shows the board, as in a drawn circle. dark_middle: something dark and round lies
    in its middle, a hole though it may be too small to be measured. circle, hole: measured on raw pixels. slope: how
    much the brightness changes along the radius, over the disc's step (0 until measured). peak: of what is no disc,
    how bright its brightest parts are.
    """

    x_px: float
    y_px: float
    area_px: float
    length_px: float
    thickness_px: float
    circularity: float
    boxed: float
    fill: float
    level: float
    contrast: float
    neck: float
    touches_border: bool
    in_needle: float
    ring: bool
    dark_middle: bool
    circle: CircleFit | None
    hole: Hole | None
    distance_px: float
    slope: float = 0.0
    peak: float = 0.0


@dataclass(frozen=True, slots=True)
class Wanted:
    """Hold what the rules look for: CAD's radius or None for the thesis' classes; the brightest round thing seen.

    board_level: brightness of the bare board, None where it is not known.
    """

    expected_radius_px: float | None
    brightest_level: float
    brightest_contrast: float = 0.0
    board_level: float | None = None

    @property
    def radii_px(self) -> tuple[tuple[float, float], ...]:
        """Return the accepted ranges of the semi-major radius, px."""
        if self.expected_radius_px is None:
            return tuple((low - CLASS_SLACK_PX, high + CLASS_SLACK_PX) for low, high in (VIA_RADIUS_PX, SITE_RADIUS_PX))
        slack = max(EXPECTED_SHARE * self.expected_radius_px, EXPECTED_SLACK_PX)
        return ((self.expected_radius_px - slack, self.expected_radius_px + slack),)

    def is_sized(self, radius_px: float) -> bool:
        """Tell whether a radius is wanted."""
        return any(low <= radius_px <= high for low, high in self.radii_px)


@dataclass(frozen=True, slots=True)
class Decided:
    """Hold an object, the verdict, and what gave it: a `RuleName`, or the function name of a rule from outside."""

    object: SeenObject
    verdict: Verdict
    rule: str


Rule = Callable[[SeenObject, Wanted], Verdict]


def small(seen: SeenObject, _wanted: Wanted) -> Verdict:
    """Throw specks (5.4.2 step 5)."""
    return Verdict.THROW if seen.area_px < LEAST_AREA_PX else Verdict.PASS


def faint(seen: SeenObject, _wanted: Wanted) -> Verdict:
    """Throw what hardly stands out: copper under the solder mask, texture.

    Copper under the mask is brighter than the mask by a share of the mask's own light. CAD's radius makes no
    exception: a via under the mask has it as well.
    """
    floor = seen.level - seen.contrast
    covered = min(COVERED_SHARE * floor, MOST_COVERED)
    return Verdict.THROW if seen.contrast < max(FAINT_CONTRAST, covered) else Verdict.PASS


def thin(seen: SeenObject, _wanted: Wanted) -> Verdict:
    """Throw lines (5.4.2 step 4)."""
    ratio = seen.length_px / max(seen.thickness_px, 1e-6)
    return Verdict.THROW if seen.circle is None and ratio > THIN_RATIO else Verdict.PASS


def needle(seen: SeenObject, _wanted: Wanted) -> Verdict:
    """Throw what lies where the needle comes in and is no circle: it is the probe, which nobody described."""
    return Verdict.THROW if seen.circle is None and seen.in_needle > PROBE_SHARE else Verdict.PASS


def wrong_size(seen: SeenObject, wanted: Wanted) -> Verdict:
    """Throw round things of another radius than CAD's; without CAD, only those far outside both classes."""
    if seen.circle is None:
        return Verdict.PASS
    radius = seen.circle.radius_px
    if wanted.is_sized(radius):
        return Verdict.PASS
    if wanted.expected_radius_px is not None:
        return Verdict.THROW if is_round(seen) else Verdict.PASS
    return Verdict.THROW if radius < 0.7 * VIA_RADIUS_PX[0] else Verdict.PASS


def stroke_end(seen: SeenObject, wanted: Wanted) -> Verdict:
    """Throw the round ends of strokes of silkscreen: they look like a filled via that goes on at its full width.

    A neck nearly as wide belongs to a stroke too when the whole is duller than the metal beside it. Lettering has no
    drilled holes: with one, it is a via, however wide its trace. Behind a probe it may be a pad that touches.
    """
    if seen.circle is None or seen.hole is not None or seen.circle.visible < WHOLE_SHAPE:
        return Verdict.PASS
    dull = seen.contrast < DULL_STROKE_SHARE * wanted.brightest_contrast
    return Verdict.THROW if seen.neck >= (WIDEST_TRACE if dull else STROKE_NECK) else Verdict.PASS


def oval(seen: SeenObject, _wanted: Wanted) -> Verdict:
    """Throw what is too oval for a circle on the board: the bend or the end of a stroke, a rounded rectangle.

    No camera looks so obliquely. With much of it hidden its shape is not known well enough to say so.
    """
    if seen.circle is None or seen.circle.visible < WHOLE_SHAPE:
        return Verdict.PASS
    return Verdict.THROW if seen.circle.ratio < OVAL_RATIO else Verdict.PASS


def cornered(seen: SeenObject, _wanted: Wanted) -> Verdict:
    """Throw squares, rounded or not: their contour has four corners, where no circle lies on it."""
    circle = seen.circle
    if circle is None or circle.visible < WHOLE_SHAPE or circle.coverage > CLEAR_COVERAGE:
        return Verdict.PASS
    return Verdict.THROW if circle.squareness > CORNERED + CORNERED_NOISE_PX / circle.radius_px else Verdict.PASS


def via_with_hole(seen: SeenObject, wanted: Wanted) -> Verdict:
    """Take small pads with a dark hole (fig. 5.17 a, b)."""
    return _take(sound(seen, wanted) and is_via(seen) and seen.hole is not None)


def via_filled(seen: SeenObject, wanted: Wanted) -> Verdict:
    """Take small pads without a hole to be seen (fig. 5.17 c), alone or joined to a net (h)."""
    return _take(sound(seen, wanted) and is_via(seen) and seen.hole is None)


def site_with_hole(seen: SeenObject, wanted: Wanted) -> Verdict:
    """Take large pads with a dark hole (fig. 5.17 d..f)."""
    return _take(sound(seen, wanted) and not is_via(seen) and seen.hole is not None)


def site_filled(seen: SeenObject, wanted: Wanted) -> Verdict:
    """Take large pads without a hole, single or touching another (fig. 5.17 g)."""
    return _take(sound(seen, wanted) and not is_via(seen) and seen.hole is None)


def border(seen: SeenObject, _wanted: Wanted) -> Verdict:
    """Throw what the window cuts off: the window has room for every pad whose centre is within reach."""
    return Verdict.THROW if seen.touches_border else Verdict.PASS


def elongated(seen: SeenObject, _wanted: Wanted) -> Verdict:
    """Throw bars and strokes: twice as long as wide, and no circle in them."""
    return Verdict.THROW if not is_round(seen) and seen.length_px > 2.0 * seen.thickness_px else Verdict.PASS


def angular(seen: SeenObject, _wanted: Wanted) -> Verdict:
    """Throw rectangles: they fill their box, and no circle lies on their edge."""
    return Verdict.THROW if not is_round(seen) and seen.boxed > ANGULAR_FILL else Verdict.PASS


def other_size(seen: SeenObject, wanted: Wanted) -> Verdict:
    """Throw objects that are no circle and too small or too large to hold a wanted one."""
    if seen.circle is not None:
        return Verdict.PASS
    low, high = wanted.radii_px[0][0], wanted.radii_px[-1][1]
    too_small = seen.length_px < 2.0 * low - 2.0 or seen.area_px < 0.5 * 3.14 * low * low
    return Verdict.THROW if too_small or seen.thickness_px > 2.6 * high else Verdict.PASS


def ragged(seen: SeenObject, _wanted: Wanted) -> Verdict:
    """Throw lettering and the like: much more rim than a round thing has (5.4.2 step 6, Heywood)."""
    return Verdict.THROW if seen.circle is None and seen.circularity > 1.6 else Verdict.PASS


NAMES: dict[Rule, RuleName] = {
    small: RuleName.SMALL,
    faint: RuleName.FAINT,
    thin: RuleName.THIN,
    border: RuleName.BORDER,
    needle: RuleName.NEEDLE,
    wrong_size: RuleName.WRONG_SIZE,
    stroke_end: RuleName.STROKE_END,
    oval: RuleName.OVAL,
    cornered: RuleName.CORNERED,
    via_with_hole: RuleName.VIA_WITH_HOLE,
    via_filled: RuleName.VIA_FILLED,
    site_with_hole: RuleName.SITE_WITH_HOLE,
    site_filled: RuleName.SITE_FILLED,
    elongated: RuleName.ELONGATED,
    angular: RuleName.ANGULAR,
    other_size: RuleName.OTHER_SIZE,
    ragged: RuleName.RAGGED,
}
"""The rules in the order in which they are asked, each with its name."""

RULES: tuple[Rule, ...] = tuple(NAMES)
"""The rules as `find_test_points` asks them; a caller may put others before or between them."""


def decide(seen: SeenObject, wanted: Wanted, rules: tuple[Rule, ...] = RULES) -> Decided:
    """Ask the rules in order about an object; the first TAKE or THROW stands, else it is undecided (PASS)."""
    for rule in rules:
        verdict = rule(seen, wanted)
        if verdict is not Verdict.PASS:
            return Decided(seen, verdict, name_of(rule))
    return Decided(seen, Verdict.PASS, RuleName.NO_RULE)


def name_of(rule: Rule) -> str:
    """Return the name of a rule; of one that is not among `RULES`, its function's."""
    return NAMES.get(rule) or rule.__name__


def is_round(seen: SeenObject) -> bool:
    """Tell whether a circle lies on enough of the object's visible edge."""
    if seen.circle is None or seen.circle.visible < LEAST_VISIBLE:
        return False
    return seen.circle.coverage >= (ROUND_COVERAGE if seen.circle.visible >= WHOLE_VISIBLE else HIDDEN_COVERAGE)


def is_clear(seen: SeenObject) -> bool:
    """Tell whether an object is a round thing beyond doubt: nothing goes on from it, nothing hides it."""
    circle = seen.circle
    if circle is None or circle.ratio < LEAST_RATIO or circle.visible < WHOLE_VISIBLE:
        return False
    return circle.coverage >= CLEAR_COVERAGE and seen.neck < CLEAR_NECK and seen.fill >= LEAST_FILL


def is_via(seen: SeenObject) -> bool:
    """Tell whether the object's circle belongs to the smaller class."""
    return seen.circle is not None and seen.circle.radius_px <= (VIA_RADIUS_PX[1] + SITE_RADIUS_PX[0]) / 2.0


def sound(seen: SeenObject, wanted: Wanted) -> bool:
    """Tell whether an object is round, of a wanted size, no part of a stroke, bright all over and as metal is here."""
    if seen.circle is None or not is_round(seen):
        return False
    slack = 0.0 if seen.circle.visible >= WHOLE_VISIBLE else HIDDEN_SLACK_PX
    sized = any(low - slack <= seen.circle.radius_px <= high + slack for low, high in wanted.radii_px)
    alone = seen.neck <= WIDEST_TRACE or seen.hole is not None
    least_ratio = LEAST_RATIO if seen.circle.coverage >= CLEAR_COVERAGE else DOUBTFUL_RATIO
    shaped = seen.circle.ratio >= least_ratio and not _square(seen.circle) and seen.fill >= LEAST_FILL
    clean = seen.circle.noise < MOST_NOISE
    bare = not _on_metal(seen, wanted)
    return alone and sized and shaped and clean and bare and not _dull(seen, seen.circle, wanted)


def _on_metal(seen: SeenObject, wanted: Wanted) -> bool:
    """Tell whether an object is a highlight on something bright: a pad stands before the board, not before metal."""
    if wanted.board_level is None:
        return False
    floor = seen.level - seen.contrast - wanted.board_level
    return floor > max(ON_METAL_SHARE * (seen.level - wanted.board_level), FAINT_CONTRAST)


def _square(circle: CircleFit) -> bool:
    """Tell whether a contour has the corners of a square; of a half-hidden one nothing is said."""
    limit = MOST_SQUARE + SQUARE_NOISE_PX / circle.radius_px
    return circle.visible >= WHOLE_SHAPE and circle.squareness > limit


def _dull(seen: SeenObject, circle: CircleFit, wanted: Wanted) -> bool:
    """Tell whether an object is too dull for the metal of this image; a partly hidden one must be as bright."""
    if circle.visible < WHOLE_VISIBLE:
        return seen.contrast < DULL_CONTRAST_SHARE * wanted.brightest_contrast
    return seen.level < DULL_SHARE * wanted.brightest_level


def _take(agreed: object) -> Verdict:
    return Verdict.TAKE if agreed else Verdict.PASS
