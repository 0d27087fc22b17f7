"""Numbers of a look, as the journal keeps them and answers tell them, and its landing, as pictures show it."""

from __future__ import annotations

import cv2
import numpy as np

from daemon.procedures.registered import Registered
from daemon.station.board_view import BoardSeen
from daemon.station.sight import Sight
from daemon.station.station import LookResult
from vision import TestPoint, Tip
from vision.annotate import Landing
from vision.geometry import Array, Correction
from vision.registration import NotRegistered


def describe(look: LookResult, target: TestPoint | Registered | None, way: Correction | None) -> dict[str, object]:
    """Return a look's numbers for the journal."""
    body: dict[str, object] = {
        "x_um": round(look.position.x_um, 2),
        "y_um": round(look.position.y_um, 2),
        "z_um": round(look.position.z_um, 2),
        "theta_deg": round(look.position.theta_deg, 5),
        "white_sequence": look.white.sequence,
    }
    if look.red is not None:
        body["red_sequence"] = look.red.sequence
    if isinstance(look.tip, Tip):
        body |= {
            "tip_px": [round(look.tip.x_px, 3), round(look.tip.y_px, 3)],
            "tip_sigma_px": round(look.tip.sigma_px, 3),
        }
        # What is told of the needle was measured in another picture where it is carried from there
        body |= {"tip_by": "marking"} if look.tip.by_marking else {"needle": _needle(look.tip)}
    if target is not None:
        body |= {"target_px": [round(target.x_px, 3), round(target.y_px, 3)], "kind": str(target.kind)}
    if look.board is not None:
        body["board"] = _registered(look.board)
    if way is not None:
        body |= {"dx_um": round(way.dx_um, 2), "dy_um": round(way.dy_um, 2), "sigma_um": round(way.sigma_um, 2)}
    return body


def landing_of(
    look: LookResult, tip: Tip, target: TestPoint | Registered, below_px: tuple[float, float], way: Correction
) -> Landing:
    """Return where the needle would come down by a look; `below_px`: from the tip's image to the place below it."""
    at = tip.x_px + below_px[0], tip.y_px + below_px[1]
    outline_px = _outline_px(look.board, target)
    return Landing((tip.x_px, tip.y_px), at, (target.x_px, target.y_px), outline_px, way.distance_um)


def sight_of(look: LookResult, tolerance_px: float) -> Sight | None:
    """Return what live pictures show of a look until the head moves; None where it showed no target."""
    at = look.landing
    if at is None:
        return None
    return Sight(at.below_px, at.target_px, tolerance_px, at.off_um, look.white.exposure_start_s)


def _outline_px(board: BoardSeen | None, target: TestPoint | Registered) -> Array | None:
    """Return the outline of the target's metal in the picture, by CAD or by what was seen."""
    if isinstance(target, TestPoint):
        axes = max(1, round(target.radius_px * target.ratio)), max(1, round(target.radius_px))
        middle = round(target.pad_px[0]), round(target.pad_px[1])
        turn_deg = round(float(np.degrees(target.minor_rad)))
        return np.asarray(cv2.ellipse2Poly(middle, axes, turn_deg, 0, 360, 10), dtype=float)
    if board is None or board.search.target is None:
        return None
    moved = board.search.target.outline_um + np.asarray(target.found.shift_um)
    return np.asarray(cv2.perspectiveTransform(moved[None].astype(float), board.board_to_px)[0], dtype=float)


def _registered(seen: BoardSeen) -> dict[str, object]:
    """Return what registration measured, or why it refused; `seat_decided`: what the picture alone left open."""
    best = seen.found.best if isinstance(seen.found, NotRegistered) else seen.found
    body: dict[str, object] = {"refused": str(seen.found.reason)} if isinstance(seen.found, NotRegistered) else {}
    if best is not None:
        body |= {
            "off_um": [round(v, 1) for v in best.shift_um],
            "turn_deg": round(best.turn_deg, 4),
            "agreement": round(best.agreement, 3),
            "log_odds": round(best.log_odds, 1),
            "edges_confirmed": round(best.near.confirmed, 3),
        }
    if seen.left_open is not None:
        body["seat_decided"] = str(seen.left_open.reason)
    return body


def _needle(tip: Tip) -> dict[str, float]:
    """Return what was measured of the needle itself; maintenance follows it over months."""
    return {
        "width_px": round(tip.width_px, 3),
        "marking_px": round(tip.shape.marking_px, 3),
        "contrast": round(tip.marking_contrast, 4),
        "bend_px": round(tip.bend_px, 3),
        "sharpness": round(tip.sharpness, 4),
        "score": round(tip.score, 4),
        "support": round(tip.edge_support, 3),
    }
