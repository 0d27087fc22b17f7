"""Basics of image measurement: images, edges, circles, robust fits, reasons for not found."""

from vision.core.caliper import (
    Fit,
    Floats,
    Line,
    derivative,
    mad_sigma,
    quantile,
    refine_peaks,
    robust_fit,
    sample,
    solve_normal,
    tukey,
)
from vision.core.circle_fit import CircleFit, Contour, fit_circle
from vision.core.edges import LEAST_SLOPE, Edgels, find_edgels
from vision.core.image import (
    SATURATED_LEVEL,
    Bgr,
    Gray,
    Plane,
    check_bgr,
    check_exposure,
    check_point,
    despike,
    gray,
    median,
    red_signal,
)
from vision.core.image_quality import ImageQuality, measure_quality
from vision.core.not_found import NotFound, Reason
from vision.core.peak import parabola
from vision.core.segment import Component, components, multi_otsu
from vision.core.view import UNKNOWN_VIEW, View

__all__ = [
    "LEAST_SLOPE",
    "SATURATED_LEVEL",
    "UNKNOWN_VIEW",
    "Bgr",
    "CircleFit",
    "Component",
    "Contour",
    "Edgels",
    "Fit",
    "Floats",
    "Gray",
    "ImageQuality",
    "Line",
    "NotFound",
    "Plane",
    "Reason",
    "View",
    "check_bgr",
    "check_exposure",
    "check_point",
    "components",
    "derivative",
    "despike",
    "find_edgels",
    "fit_circle",
    "gray",
    "mad_sigma",
    "measure_quality",
    "median",
    "multi_otsu",
    "parabola",
    "quantile",
    "red_signal",
    "refine_peaks",
    "robust_fit",
    "sample",
    "solve_normal",
    "tukey",
]
