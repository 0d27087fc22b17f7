"""Diagnosis of a failed tip search: light, focus, direction, width, or no probe at all.

This runs only after a search has failed, so it may take its time; it never turns a refusal into a tip.
"""

from __future__ import annotations

import cv2
import numpy as np

from vision.core import SATURATED_LEVEL, Floats, Gray, NotFound, Plane, Reason, derivative
from vision.tip.checks import TURN_LIMIT_DEG
from vision.tip.measure import TipSighting, sight
from vision.tip.outline import EdgePairs
from vision.tip.probe_model import ProbeModel
from vision.tip.strip import ProbeStrip, quantiles, straighten
from vision.tip.template_search import TAUGHT_SCORE, search
from vision.tip.verdicts import blurred

WIDE_TURNS_DEG = tuple(float(d) for d in np.arange(-18.0, 18.1, 3.0))
"""Directions a probe may have been turned to."""
LEAST_TURNED, TURNED_LEAD = 0.5, 0.12
"""There it shows so much of its outline (0..1), and so much more than in the taught direction."""
MOST_CLIPPED = 0.2
"""Share of clipped pixels round the probe from which its edges say nothing."""
LEAST_STRIP_SHARPNESS = 0.08
LIKE_A_PROBE = 0.7
"""Correlation with the golden template: 0.9 and more when blurred by 4 px and more, 0.55 at most without a probe."""
SIDE_SPARE_PX = 24
LEAST_BAR, MOST_OF_OWN, MOST_OWN_BAR = 0.55, 0.85, 0.35
"""A bar shows both edges on so much of its length (0..1); the taught width beside it shows no more than that."""
OTHER_WIDTH = 0.12
MOSTLY = 0.8
SCAN_TILTS, SCAN_SHIFTS_PX = np.tan(np.radians(np.arange(-3.0, 3.1, 1.0))), np.arange(-12.0, 12.1, 2.0)


def name_it(
    plane: Gray, sighting: TipSighting, model: ProbeModel, origin: tuple[int, int], problem: NotFound
) -> NotFound:
    """Return the likeliest reason why `problem` arose, `problem` itself when nothing better is known."""
    strip = sighting.strip
    clipped = float(np.mean(strip.pixels >= SATURATED_LEVEL))
    if clipped > MOST_CLIPPED:
        return NotFound(
            Reason.SATURATED,
            f"{100 * clipped:.0f} % of the pixels round the needle are at full scale: shorten the exposure or look for "
            "a second light",
        )
    # A blurred probe still looks like one from afar; a bare board in its place has nothing sharp either.
    sharpness = strip_sharpness(strip)
    if sharpness < LEAST_STRIP_SHARPNESS and sighting.match.score > LIKE_A_PROBE:
        return blurred(sharpness, LEAST_STRIP_SHARPNESS)
    image = plane.astype(np.float32)
    for better in (_turned(image, plane, sighting, model, origin), _other_width(image, sighting, model)):
        if better is not None:
            return better
    return problem


def strip_sharpness(strip: ProbeStrip) -> float:
    """Return the steepest slopes across the strip over its range of levels, 1/px."""
    slope = np.abs(derivative(np.ascontiguousarray(strip.pixels[::2]), 1.0))
    low, high = quantiles(strip.pixels[::4, ::4], 0.02, 0.99)
    return quantiles(slope[:, ::2], 0.0, 0.99)[1] / max(high - low, 1.0)


def _turned(
    image: Plane, plane: Gray, sighting: TipSighting, model: ProbeModel, origin: tuple[int, int]
) -> NotFound | None:
    """Return `bent` when the taught probe shows clearly better in a direction out of the taught range."""
    seen = sight(image, search(plane, model, origin, WIDE_TURNS_DEG), model, origin)
    turn = float(np.degrees(seen.angle_rad - model.angle_rad))
    if abs(turn) <= TURN_LIMIT_DEG or seen.vote.share < max(LEAST_TURNED, sighting.vote.share + TURNED_LEAD):
        return None
    return NotFound(
        Reason.BENT, f"the needle is turned by {turn:+.1f} degrees against the taught one: straighten or replace it"
    )


def _other_width(image: Plane, sighting: TipSighting, model: ProbeModel) -> NotFound | None:
    """Return `wrong_needle` when a bar of another width than the taught cylinder's shows clearly better."""
    taught, strip = model.shape.cylinder_half_px, sighting.strip
    halves = np.arange(0.4 * taught, 2.0 * taught, 0.5)
    reach = int(2.0 * taught) + SIDE_SPARE_PX
    at = strip.to_image(0.0, 0.0)
    wide = straighten(image, at, strip.angle_rad, strip.u_from_px, strip.u_from_px + strip.pixels.shape[0], reach)
    edges, u = EdgePairs.of(wide), model.outline.u_px[: model.outline.cylinder_rows]
    lines = [(float(t), float(v - t * u.mean())) for t in SCAN_TILTS for v in SCAN_SHIFTS_PX]
    all_shares = np.stack([edges.pairs(u, tilt, shift, halves).mean(axis=0) for tilt, shift in lines])
    shares = all_shares.max(axis=0)
    ratio = halves / taught
    own = float(shares[np.abs(ratio - 1.0) < OTHER_WIDTH].max())
    wider, narrower = (np.where(other, shares, 0.0) for other in (ratio > 1.0 + OTHER_WIDTH, ratio < 1.0 - OTHER_WIDTH))
    # Highlights make probes inside the probe: the outer edges count, the inner ones only when there are no others.
    if wider.max() >= max(LEAST_BAR, MOST_OF_OWN * own):
        pick = int(np.argmax(wider))
    # A narrow bar in the taught needle is its streak of light.
    elif narrower.max() >= LEAST_BAR and own < MOST_OWN_BAR and sighting.match.score < TAUGHT_SCORE:
        pick = int(np.argmax(narrower))
    else:
        return None
    half = float(halves[pick])
    if not _stands_alone(wide, u, lines[int(np.argmax(all_shares[:, pick]))], half, max(half, taught)):
        return None
    return NotFound(
        Reason.WRONG_NEEDLE,
        f"the needle is about {2 * half:.0f} px wide, {2 * taught:.0f} px were taught: mount the taught needle "
        "or teach this one",
    )


def _stands_alone(strip: ProbeStrip, u_px: Floats, line: tuple[float, float], half_px: float, widest_px: float) -> bool:
    """Return whether a bar is brighter all across than what lies beside it, and that no brighter than further out.

    Two lines of lettering have a gap between them; a highlight has metal beside it, and before a bright ground the
    metal lies between two things that are brighter.
    """
    smooth = cv2.blur(strip.pixels, (3, 9))
    rows = np.rint(u_px).astype(np.intp) - strip.u_from_px
    rows = rows[(rows >= 0) & (rows < smooth.shape[0])]
    centre = line[0] * (rows + strip.u_from_px) + line[1] + strip.reach_px
    last, inner = smooth.shape[1] - 1, np.arange(-half_px + 4.0, half_px - 3.9, 2.0)

    def levels(off_axis: Floats) -> Plane:
        columns = np.clip(np.rint(centre[:, None] + off_axis).astype(np.intp), 0, last)
        return np.asarray(smooth[rows[:, None], columns], dtype=np.float32)

    inside = levels(inner)
    beside = levels(np.array([-half_px - 6.0, half_px + 6.0])).mean(axis=1)
    further = levels(np.array([-widest_px - 8.0, widest_px + 8.0])).mean(axis=1)
    solid = float(np.mean(inside.min(axis=1) > beside))
    metal_beside = float(np.mean(beside > further + 0.5 * (inside.mean(axis=1) - further)))
    lit = float(np.mean(inside.mean(axis=1) > further))
    return solid > MOSTLY and lit > MOSTLY and metal_beside < 1.0 - MOSTLY
