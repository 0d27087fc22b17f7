"""Registration of a look: where CAD puts the board in the red frame, and what the picture says of it.

One homography takes the board frame (um) to pixels: pose map, tip, head angle, height and the board's pose together.
What the needle hides is left out. Where registration fails, the whole board is asked why.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from daemon.station.board_references import BoardSides
from daemon.station.kinematics import Geometry
from daemon.station.wide_view import Bend
from drivers.camera.contract import Pixels
from drivers.gantry import Position
from vision import NotFound, TestPoint, Tip, registration
from vision.geometry import Array, PoseMap
from vision.pads import confirm_pad
from vision.registration import LayerFit, NotRegistered, Reference, Refusal, Registration, Target
from vision.tip import probe_outline

NEEDLE_MARGIN_PX = 4.0
SPAN_UM = 6000.0
"""Half of the square about the place over which the map to pixels is fitted."""
MOST_RESIDUAL_PX = 0.05
LEAST_AGREEMENT, LEAST_NEAR = 0.2, 0.2
"""With less of the view, or of the metal edges about the tip, confirmed nothing is learned: the board is elsewhere."""
WITNESS_REACH_UM = 150.0
"""How far about the registered place a round target is looked for."""


@dataclass(frozen=True)
class HeadView:
    """How the head stands over the board, for a map that holds at this height."""

    geometry: Geometry
    pose_map: PoseMap
    position: Position
    height_um: float

    def board_to_px(self, tip: Tip, about_um: tuple[float, float]) -> Array:
        """Return the homography (3, 3) from the board frame, um, to pixels; ValueError where the map is none."""
        corners = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]) * SPAN_UM
        there = self._to_px(corners + about_um, tip)
        local: Array = np.asarray(
            cv2.getPerspectiveTransform(corners.astype(np.float32), there.astype(np.float32)), dtype=float
        )
        steps = np.linspace(-SPAN_UM, SPAN_UM, 5)
        grid = np.array([(x, y) for x in steps for y in steps])
        mapped = cv2.perspectiveTransform(grid[None], local)[0]
        worst_px = float(np.abs(mapped - self._to_px(grid + about_um, tip)).max())
        if not worst_px <= MOST_RESIDUAL_PX:
            raise ValueError(f"the map from board to picture is no homography: it is {worst_px:.2f} px off")
        moved = np.array([[1.0, 0.0, -about_um[0]], [0.0, 1.0, -about_um[1]], [0.0, 0.0, 1.0]])
        whole: Array = local @ moved
        return whole

    def _to_px(self, board_um: Array, tip: Tip) -> Array:
        from_tip = self.geometry.board_to_robot_um(board_um) - self.geometry.tip_um(self.position)
        return self.pose_map.to_px(from_tip, (tip.x_px, tip.y_px), self.position.theta_deg, height_um=self.height_um)


@dataclass(frozen=True, eq=False)
class BoardSearch:
    """What to register in a red frame.

    reference: CAD about the place. target: None asks for the board alone. sides: the whole board, which says why
    nothing could be registered. bend: what was learned of the map's far parts (`wide_view`), nearest to this height;
    None: nothing yet.
    measure_layers: measure by how much ink and openings of this board lie off its copper, and draw them so. last:
    the registration of the look before, in the same job. round_um: diameter of a target whose round outline leads to
    it; hole_um: of its hole, 0 without one, None where that is not known.
    """

    view: HeadView
    reference: Reference
    target: Target | None
    sides: BoardSides
    bend: Bend | None = None
    measure_layers: bool = False
    last: Registration | None = None
    round_um: float | None = None
    hole_um: float | None = None


@dataclass(frozen=True, eq=False)
class BoardSeen:
    """What a red frame says of where the board lies.

    witness: the round target that was seen at the registered place without CAD, None where none was. moved: it had to
    be registered anew, for it was not where the look before had it. bend: what this look taught of the map's far parts.
    layers: what it says of ink and openings, if that was asked for. left_open: why the picture alone did not say what
    was `found`, where something else decided it.
    """

    found: Registration | NotRegistered
    board_to_px: Array
    hidden_px: tuple[Array, ...]
    search: BoardSearch
    witness: TestPoint | None = None
    moved: bool = False
    bend: Bend | None = None
    layers: LayerFit | None = None
    left_open: NotRegistered | None = None


def see_board(red_bgr: Pixels, tip: Tip, search: BoardSearch) -> BoardSeen:
    """Register a red frame; blocks for some tens of milliseconds, and longer where it fails: for a worker thread."""
    mapped = search.view.board_to_px(tip, search.reference.about_um)
    to_px = mapped if search.bend is None else search.bend.homography @ mapped
    hidden = (probe_outline((tip.x_px, tip.y_px), tip.angle_rad, tip.shape, NEEDLE_MARGIN_PX),)
    found: Registration | NotRegistered | None = None
    if search.last is not None:
        found = registration.follow(search.reference, red_bgr, to_px, search.target, search.last, hidden)
    moved = isinstance(found, NotRegistered) and found.reason is Refusal.WRONG_PLACE
    if found is None or moved:
        found = registration.register(search.reference, red_bgr, to_px, search.target, hidden)
    bend = _learn(red_bgr, to_px, search, found, hidden)
    if bend is not None:
        bent = bend.homography @ mapped
        again = registration.register(search.reference, red_bgr, bent, search.target, hidden)
        if _holds(search) and isinstance(again, NotRegistered):
            bend = None
        else:
            to_px, found = bent, again
    layers = _measure_layers(red_bgr, to_px, search, found, hidden) if search.measure_layers else None
    if layers is not None and isinstance(found, NotRegistered):
        shifted = registration.prepare(search.sides.here, search.reference.about_um, layers.shifts)
        found = registration.register(shifted, red_bgr, to_px, search.target, hidden)
    if isinstance(found, NotRegistered) and found.reason is not Refusal.FRAME_UNUSABLE:
        about_um = search.reference.about_um
        found = registration.explain(found, red_bgr, to_px, about_um, *search.sides.whole(), hidden_px=hidden)
    registered = isinstance(found, Registration)
    witness = _witness(red_bgr, tip, search, found) if isinstance(found, Registration) else None
    return BoardSeen(
        found, to_px, hidden, search, witness, moved=moved, bend=bend if registered else None, layers=layers
    )


def _measure_layers(
    red_bgr: Pixels,
    to_px: Array,
    search: BoardSearch,
    found: Registration | NotRegistered,
    hidden: tuple[Array, ...],
) -> LayerFit | None:
    """Measure the layers' shifts where the place is known at least."""
    known = registration.place_known(found)
    if known is None:
        return None
    fit = registration.fit_layers(search.sides.here, search.reference.about_um, red_bgr, to_px, known, hidden)
    return None if isinstance(fit, NotRegistered) else fit


def _learn(
    red_bgr: Pixels,
    to_px: Array,
    search: BoardSearch,
    found: Registration | NotRegistered,
    hidden: tuple[Array, ...],
) -> Bend | None:
    """Learn the map's far parts at this height, if the board was seen near the tip at least.

    Where they are known at this height they are learned again only for a look that was refused though the metal edges
    near the tip are in their places: this board may lie higher or lower than the last one.
    """
    if not _holds(search):
        best = found.best if isinstance(found, NotRegistered) else found
    elif isinstance(found, NotRegistered):
        best = registration.place_known(found)
    else:
        return None
    if best is None or best.agreement < LEAST_AGREEMENT:
        return None
    if best.near.cells and best.near.confirmed < LEAST_NEAR:
        return None
    start = search.reference.about_um, best
    fresh = registration.find_bend(search.sides.here, red_bgr, to_px, start, hidden)
    if fresh is None:
        return None
    before = np.eye(3) if search.bend is None else search.bend.homography
    return Bend(fresh @ before, search.view.height_um)


def _holds(search: BoardSearch) -> bool:
    """Whether the map's far parts are known at this height."""
    return search.bend is not None and search.bend.holds_at(search.view.height_um)


def settle(seen: BoardSeen, red_bgr: Pixels, tip: Tip, shift_um: tuple[float, float]) -> BoardSeen:
    """Measure the place `shift_um` of a tie, of which something else than the picture says that it is the right one."""
    best = seen.found.best if isinstance(seen.found, NotRegistered) else None
    if best is None:
        return seen
    start = replace(best, shift_um=shift_um, rivals=())
    search = seen.search
    found = registration.follow(search.reference, red_bgr, seen.board_to_px, search.target, start, seen.hidden_px)
    return seen if isinstance(found, NotRegistered) else accept(seen, red_bgr, tip, found)


def accept(seen: BoardSeen, red_bgr: Pixels, tip: Tip, found: Registration) -> BoardSeen:
    """Take for the board's place what the picture alone left open; all else that speaks for or against it is kept."""
    left_open = seen.found if isinstance(seen.found, NotRegistered) else None
    return replace(seen, found=found, left_open=left_open, witness=_witness(red_bgr, tip, seen.search, found))


def _witness(red_bgr: Pixels, tip: Tip, search: BoardSearch, found: Registration) -> TestPoint | None:
    """Look for a round target at the registered place by its outline alone (TDEA); what is not seen says nothing."""
    if search.round_um is None:
        return None
    scale = search.view.pose_map.scale_px_per_um((tip.x_px, tip.y_px))
    radius_px = search.round_um / 2 * scale
    hole_px = None if search.hole_um is None else search.hole_um / 2 * scale
    seen = confirm_pad(red_bgr, found.target_px, radius_px, hole_px, tip, reach_px=WITNESS_REACH_UM * scale)
    return None if isinstance(seen, NotFound) else seen
