"""Registration of a board's CAD to the red picture: where the board lies, and so where each pad is."""

from vision.registration.answer import Edges, NotRegistered, Refusal, Registration, Rival, Target
from vision.registration.bend import find_bend
from vision.registration.drawing import IndexedSide, LayerShifts, index_side
from vision.registration.explain import explain
from vision.registration.follow import follow
from vision.registration.layer_fit import LayerFit, fit_layers, median_shifts
from vision.registration.layers import Hole, Polygon, SideLayers
from vision.registration.outlines import EdgeMarks, mark_edges
from vision.registration.reference import Reference, prepare
from vision.registration.register import place_known, register
from vision.registration.site import Site, free_site
from vision.registration.unique import UNIQUE_SCORE, UniquePlace, how_unique, unique_places
from vision.registration.whole import Whole, draw_whole

__all__ = [
    "UNIQUE_SCORE",
    "EdgeMarks",
    "Edges",
    "Hole",
    "IndexedSide",
    "LayerFit",
    "LayerShifts",
    "NotRegistered",
    "Polygon",
    "Reference",
    "Refusal",
    "Registration",
    "Rival",
    "SideLayers",
    "Site",
    "Target",
    "UniquePlace",
    "Whole",
    "draw_whole",
    "explain",
    "find_bend",
    "fit_layers",
    "follow",
    "free_site",
    "how_unique",
    "index_side",
    "mark_edges",
    "median_shifts",
    "place_known",
    "prepare",
    "register",
    "unique_places",
]
