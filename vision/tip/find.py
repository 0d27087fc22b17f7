"""Search for the end of the probe in a white-lit image (TEDA, thesis 5.3).

The end itself is a few dull pixels before a busy board, so it is not looked for. The probe is (golden template),
its two straight edges give the bisector, the marking's lower rim gives a sharp mark on it, and the end lies the taught
h px further along. Every step that does not look as taught ends the search: no answer is better than a wrong one.
The ground may be darker than the metal or brighter, on either side: only teaching asks for a dark, quiet one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vision.core import Bgr, Floats, Gray, Line, NotFound, Reason, check_bgr, check_exposure, despike, gray
from vision.tip.checks import check_direction, first_problem
from vision.tip.diagnosis import name_it
from vision.tip.glint import without_glint
from vision.tip.measure import MeasuredTip, coarse_shift, measure, sight
from vision.tip.probe_model import ProbeModel
from vision.tip.strip import ProbeShape
from vision.tip.template_search import TemplateMatch, region, search
from vision.tip.verdicts import no_marking, wrong

DARK_LEVEL = 12.0
"""A lit board or base plate is brighter than this; the probe may be missing, so it is not asked."""
LEAST_VOTE = 0.35
"""Share of the calipers that must find the taught silhouette before anything is measured."""
ALONG_SIGMA_PX, ACROSS_SIGMA_PX, BLUNT_ACROSS_SIGMA_PX = 0.08, 0.14, 0.18
"""What stays of errors the fit cannot see, along the probe (interpolation, the rim's own form) and across it (light
from another side, and the teaching's own noise at the end of a long lever), more where no taper holds the axis."""


@dataclass(frozen=True, slots=True)
class Tip:
    """Hold the probe's end and what was measured on the way.

    x_px, y_px: the end; angle_rad: direction of the probe towards it; sigma_px: honest 1-sigma of each coordinate, the
    mean of sigma_along_px and sigma_across_px, which are those along the probe and across it (0 where not measured).
    edges: L1 (found from the right) and L2 (from the left); intersection_px: where they would meet (eq. 5.7), of a
    blunt needle, whose edges do not, the end;
    rim1_px, rim2_px: upper and lower rim of the marking on the bisector; score: correlation with the golden template;
    marking_contrast: 0..1; width_px: of the cylinder; bend_px: how far taper and cylinder disagree at the end;
    sharpness: steepest slope of the lower rim over its step, 1/px (it falls as the image blurs); edge_support: share
    of calipers that lie on the fitted silhouette; shape: that silhouette. by_marking: the ground hid the edges; all of
    it was measured in a picture before, and moved to where marking and light show the needle now (`KnownTip`).
    """

    x_px: float
    y_px: float
    angle_rad: float
    sigma_px: float
    score: float
    edges: tuple[Line, Line]
    intersection_px: tuple[float, float]
    rim1_px: tuple[float, float]
    rim2_px: tuple[float, float]
    marking_contrast: float
    width_px: float
    bend_px: float
    sharpness: float
    edge_support: float
    shape: ProbeShape
    sigma_along_px: float = 0.0
    sigma_across_px: float = 0.0
    by_marking: bool = False

    def moved(self, dx_px: float, dy_px: float) -> Tip:
        """Return the tip, and all that was measured with it, so many pixels aside."""

        def there(point: tuple[float, float]) -> tuple[float, float]:
            return point[0] + dx_px, point[1] + dy_px

        first, second = (replace(line, x_px=line.x_px + dx_px, y_px=line.y_px + dy_px) for line in self.edges)
        return replace(
            self,
            x_px=self.x_px + dx_px,
            y_px=self.y_px + dy_px,
            edges=(first, second),
            intersection_px=there(self.intersection_px),
            rim1_px=there(self.rim1_px),
            rim2_px=there(self.rim2_px),
        )

    @property
    def covariance_px2(self) -> Floats:
        """Return the covariance (2, 2) of the end's x and y, px^2; zero where it was not measured."""
        c, s = np.cos(self.angle_rad), np.sin(self.angle_rad)
        turn = np.array([[c, -s], [s, c]])
        return np.asarray(turn @ np.diag([self.sigma_along_px**2, self.sigma_across_px**2]) @ turn.T)


def find_tip(white_bgr: Any, model: ProbeModel) -> Tip | NotFound:
    """Find the probe's end in a white image (H, W, 3) uint8 BGR, in the image's pixels.

    Accurate to about 0.15 px on clean images, before a board and before white paper with a printed mark alike;
    `Tip.sigma_px` says how well this time. Before a ground about as bright as the metal's edges it may find nothing,
    and a probe taught as lit from one side is found before darker grounds only. Returns NotFound with one of too_dark,
    saturated, blurred, out_of_frame, no_needle, wrong_needle, no_marking, bent. ValueError for an array of another
    shape or type.
    """
    image = check_bgr(white_bgr)
    x, y, width, height = region(model)
    if x < 0 or y < 0 or x + width > image.shape[1] or y + height > image.shape[0]:
        return NotFound(
            Reason.OUT_OF_FRAME,
            f"the needle is expected within x {x}..{x + width}, y {y}..{y + height} px, the picture has only "
            f"{image.shape[1]} x {image.shape[0]}: set the camera's size as it was when the needle was taught",
        )
    part: Bgr = image[y : y + height, x : x + width]
    plane = gray(part)
    problem = check_exposure(plane, dark_level=DARK_LEVEL, dark_percentile=50.0, clipped_share=0.25)
    if problem is not None:
        return problem
    clean = despike(plane)
    found = _find(clean, model, (x, y))
    return found if isinstance(found, NotFound) else found.moved(x, y)


def _find(clean: Gray, model: ProbeModel, origin: tuple[int, int]) -> Tip | NotFound:
    """Find the end in the region; everything here is in the pixels of the region."""
    image = clean.astype(np.float32)
    seen = sight(image, search(clean, model, origin), model, origin)

    def named(problem: NotFound) -> NotFound:
        return name_it(clean, seen, model, origin, problem)

    if seen.vote.share < LEAST_VOTE:
        fact = f"the edges of the taught needle show on only {100 * seen.vote.share:.0f} % of its length"
        return named(NotFound(Reason.NO_NEEDLE, f"{fact}: is it mounted, is the white lamp on?"))
    problem = check_direction(seen.angle_rad, model)
    if problem is not None:
        return named(problem)
    shift = coarse_shift(seen, model.shape)
    if shift is None:
        return named(no_marking("no dark band with a rim on each side was found on the needle"))
    probe = measure(image, seen, shift, model)
    if probe is None:
        return named(wrong("too few edges lie on the taught silhouette"))
    problem = first_problem(probe, model)
    if problem is not None:
        spared = without_glint(probe, model)
        if spared is not None and first_problem(spared, model) is None:
            probe, problem = spared, None
    return _conclude(probe, seen.match, model) if problem is None else named(problem)


def _conclude(probe: MeasuredTip, match: TemplateMatch, model: ProbeModel) -> Tip:
    """Place the end h px beyond the lower rim on the bisector and gather what was measured."""
    strip, axis, rim2, shape = probe.strip, probe.axis, probe.rim2, model.shape
    end_u = rim2.u_px + shape.end_to_rim_px / float(np.sqrt(1.0 + axis.b**2))
    x, y = strip.to_image(end_u, axis.v_px(end_u))
    lever = np.array([1.0, end_u])
    across = float(lever @ axis.covariance @ lever)
    along = float(np.hypot(rim2.sigma_px, ALONG_SIGMA_PX))
    aside = float(np.sqrt(across + (ACROSS_SIGMA_PX if shape.tapers else BLUNT_ACROSS_SIGMA_PX) ** 2))
    half, slope = shape.end_half_px + axis.taper_wider_px, shape.taper_slope
    meet_u = half / slope if shape.tapers else end_u
    cylinder = shape.cylinder_half_px + axis.cylinder_wider_px
    measured = ProbeShape(shape.end_to_rim_px, rim2.u_px - probe.rim1_u_px, half, slope, cylinder)
    return Tip(
        x_px=x,
        y_px=y,
        angle_rad=strip.angle_rad + float(np.arctan(axis.b)),
        sigma_px=float(np.sqrt((along**2 + aside**2) / 2.0)),
        score=match.score,
        edges=(_edge_line(probe, measured, -1.0), _edge_line(probe, measured, 1.0)),
        intersection_px=strip.to_image(meet_u, axis.v_px(meet_u)),
        rim1_px=strip.to_image(probe.rim1_u_px, axis.v_px(probe.rim1_u_px)),
        rim2_px=strip.to_image(rim2.u_px, axis.v_px(rim2.u_px)),
        marking_contrast=probe.contrast,
        width_px=2.0 * cylinder,
        bend_px=probe.free.bend_px,
        sharpness=probe.sharpness,
        edge_support=axis.support,
        shape=measured,
        sigma_along_px=along,
        sigma_across_px=aside,
    )


def _edge_line(probe: MeasuredTip, shape: ProbeShape, side: float) -> Line:
    """Return the taper's edge on one side as a line in the image, through its point at u = 0."""
    strip, axis = probe.strip, probe.axis
    x, y = strip.to_image(0.0, axis.a_px + side * shape.end_half_px)
    angle = strip.angle_rad + float(np.arctan(axis.b - side * shape.taper_slope))
    return Line(
        x_px=x,
        y_px=y,
        angle_rad=angle,
        sigma_px=float(np.sqrt(axis.covariance[0, 0])),
        used=round(100 * axis.support),
        offered=100,
    )
