"""Features of a disc for the rules: its levels, its hole, how much of it is bright, what goes on beyond it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vision.core import CircleFit, Contour, Edgels, quantile
from vision.pads.disc_fit import DiscFit, measure_disc
from vision.pads.hole import DIP_RADIUS_PX, find_hole, is_ring
from vision.pads.neck import neck_width
from vision.pads.patch import cut_patch
from vision.pads.rules import LEAST_VISIBLE, ROUND_COVERAGE, Hole, SeenObject
from vision.pads.window import Window

HOLE_STEP, LARGE_HOLE_STEP = 0.55, 0.75
"""Measured without its blur a hole lies below its pad by at least this share of the pad's step, in a small pad and in a
large one; a probe's mark does not."""
DENT_SHARE, DENT_OFF, DRILL_OFF, DARKER_THAN_BOARD = 0.29, 0.08, 0.15, 1.03
"""What a probe leaves in a large pad can be as dark as the board. It is narrower than this share of the pad's radius
and lies anywhere: farther off the middle than the second share where it is no darker than the board (the last share of
the pad's step), than the third however dark it is. A drill is guided, and shows what is darker than the board."""
HOLE_EVIDENCE = 30.0
"""The hole of a small pad must explain the pixels better by this much: chi square of four parameters, far out."""
PLAUSIBLE_RATIO = 0.68
"""Edge points alone give an ellipse's ratio to about 0.05; a pad's is 0.785 or more."""
LEAST_CLEAR = 0.3
"""Levels are taken where nothing can stand in front, if that is this share of the disc or more."""
MOST_REFINED_PX, MOST_REFINED_SHARE = 1.0, 0.07
"""A measured disc that differs from its edge points by more than this (px, or share of the radius) is something
else."""


def describe_disc(window: Window, edgels: Edgels, circle: CircleFit) -> SeenObject:
    """Return the features of a disc from the pixels inside and around it, in the window's pixels."""
    patch = cut_patch(window, circle)
    inside, around = patch.rho < 0.85, patch.rho > 1.0 + 2.0 / circle.radius_px
    clear = patch.free & ~window.maybe_hidden[patch.box]
    if np.count_nonzero(clear & inside) < LEAST_CLEAR * np.count_nonzero(inside):
        clear = patch.free
    disc, ring = patch.level[inside & clear], patch.level[around & clear]
    level = quantile(disc, 0.65) if disc.size else 0.0
    floor = quantile(ring, 0.4) if ring.size else window.board_level
    idea, hole, measured, slope = None, None, None, 0.0
    if level > floor and _may_be_a_pad(circle):
        idea = find_hole(window, edgels, circle, patch, level - floor, level)
        hole, measured, slope = _measure(window, circle, idea)
    body = inside & clear
    # Dark middles that could not be measured, seen obliquely through a thick board, are holes all the same.
    bore = hole or idea
    if bore is not None:
        body &= patch.distance_px(bore.x_px, bore.y_px) > bore.radius_px + 1.5
    fill = float(np.mean(patch.level[body] > (level + floor) / 2.0)) if np.any(body) else 0.0
    if measured is not None:
        circle = measured
    height, width = window.shape
    outside = min(circle.x_px, circle.y_px, width - 1 - circle.x_px, height - 1 - circle.y_px) < circle.radius_px + 1.0
    size = 2.0 * circle.radius_px
    return SeenObject(
        x_px=circle.x_px,
        y_px=circle.y_px,
        area_px=float(np.pi * circle.radius_px**2),
        length_px=size,
        thickness_px=size,
        circularity=1.0,
        boxed=float(np.pi / 4.0),
        fill=fill,
        level=level,
        contrast=level - floor,
        neck=neck_width(window, circle, (level + floor) / 2.0),
        touches_border=outside,
        in_needle=0.0,
        dark_middle=bore is not None,
        ring=is_ring(circle, patch, idea, floor, level - floor),
        circle=circle,
        hole=hole,
        distance_px=window.distance_px(circle.x_px, circle.y_px),
        slope=slope,
    )


def _may_be_a_pad(circle: CircleFit) -> bool:
    """Tell whether measuring is worth the time: what is not round enough is never taken."""
    return circle.coverage >= ROUND_COVERAGE and circle.visible >= LEAST_VISIBLE and circle.ratio > PLAUSIBLE_RATIO


def _measure(window: Window, circle: CircleFit, idea: Contour | None) -> tuple[Hole | None, CircleFit | None, float]:
    """Measure the disc, hole and the slope of its light on its pixels; the circle is None where the model fails."""

    def attempt(hole: Contour | None) -> DiscFit | None:
        return measure_disc(
            window.raw, circle.contour, window.view, hole=hole, usable=~window.hidden, sectors=circle.sectors
        )

    fit = attempt(idea) if idea is not None else None
    small = circle.radius_px < DIP_RADIUS_PX
    if fit is None or fit.hole_step < (HOLE_STEP if small else LARGE_HOLE_STEP) * fit.step:
        fit = attempt(None)
    elif small:
        plain = attempt(None)
        if plain is not None and plain.misfit - fit.misfit < HOLE_EVIDENCE * fit.noise**2:
            fit = plain
    elif window.hole_radius_px is None and _is_dent(fit):
        fit = attempt(None)
    if fit is None:
        return None, None, 0.0
    contour = fit.contour
    moved = np.hypot(contour.x_px - circle.x_px, contour.y_px - circle.y_px)
    grown = abs(contour.radius_px - circle.contour.radius_px)
    if max(moved, grown) > max(MOST_REFINED_PX, MOST_REFINED_SHARE * circle.radius_px):
        return None, None, 0.0
    radius, ratio, minor = contour.ellipse(window.view)
    better = replace(
        circle,
        x_px=contour.x_px,
        y_px=contour.y_px,
        radius_px=radius,
        ratio=ratio,
        minor_rad=minor,
        sigma_px=fit.sigma_px,
        noise=fit.noise / fit.step,
        contour=contour,
    )
    if fit.hole is None:
        return None, better, fit.slope
    size, _, _ = fit.hole.ellipse(window.view)
    return Hole(fit.hole.x_px, fit.hole.y_px, size, fit.hole_sigma_px), better, fit.slope


def _is_dent(fit: DiscFit) -> bool:
    """Tell whether a dark place in a large pad is what a probe left, and no hole."""
    if fit.hole is None or fit.hole.radius_px > DENT_SHARE * fit.contour.radius_px:
        return False
    off = float(np.hypot(fit.hole.x_px - fit.contour.x_px, fit.hole.y_px - fit.contour.y_px))
    dark = fit.hole_step > DARKER_THAN_BOARD * fit.step
    return off > (DRILL_OFF if dark else DENT_OFF) * fit.contour.radius_px
