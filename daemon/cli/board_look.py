"""A stored red picture with a board file: CAD registered to it, by the daemon's own functions."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rich.markup import escape
from rich.table import Table

from daemon.cli.output import USAGE, fail
from daemon.cli.picture_files import Pixels
from daemon.cli.points import point_option
from daemon.cli.vision_output import number, numbers
from daemon.domain.board import NO_LAYERS, Board, BoardPoint
from daemon.domain.errors import Fault
from daemon.procedures.sites import looks_known, target_of
from daemon.station.board_references import BoardSides
from daemon.station.board_view import NEEDLE_MARGIN_PX
from vision import Tip, registration
from vision.annotate import BoardLook
from vision.geometry import Array, PoseMap
from vision.registration import LayerShifts, NotRegistered, Registration
from vision.tip import probe_outline

SPAN_UM = 6000.0


@dataclass(frozen=True)
class BoardAsked:
    """Hold what is to be registered. at: a target's name, or X,Y on the board, um, below the tip as planned."""

    board: Path
    at: str
    pose_map: Path
    theta_deg: float


def register_board(red: Pixels, tip: Tip | tuple[float, float], asked: BoardAsked) -> BoardLook:
    """Register the board where the head stood over a place of it; ends with a message for files that are no good."""
    board = _load_board(asked.board)
    place_um, point = _place(board, asked.at)
    pose_map = _load_map(asked.pose_map)
    tip_px = (tip.x_px, tip.y_px) if isinstance(tip, Tip) else tip
    mapped = _board_to_px(pose_map, tip_px, place_um, asked.theta_deg)
    hidden = (probe_outline(tip_px, tip.angle_rad, tip.shape, NEEDLE_MARGIN_PX),) if isinstance(tip, Tip) else ()
    sides = BoardSides(board)
    target = None if point is None else target_of(point)
    if target is not None and not looks_known(target, sides.obstacles):
        target = None
    reference = registration.prepare(sides.here, place_um, LayerShifts())
    found = registration.register(reference, red, mapped, target, hidden)
    best = found.best if isinstance(found, NotRegistered) else found
    bend = None if best is None else registration.find_bend(sides.here, red, mapped, (place_um, best), hidden)
    if bend is not None:
        mapped = bend @ mapped
        found = registration.register(reference, red, mapped, target, hidden)
    if isinstance(found, NotRegistered):
        found = registration.explain(found, red, mapped, place_um, *sides.whole(), hidden_px=hidden)
    return BoardLook(sides.here, place_um, mapped, found, target, hidden)


def board_facts(look: BoardLook) -> dict[str, Any]:
    """Return what registration says, for JSON."""
    answer = look.answer
    best = answer.best if isinstance(answer, NotRegistered) else answer
    facts: dict[str, Any] = {"found": isinstance(answer, Registration)}
    if isinstance(answer, NotRegistered):
        facts |= {"reason": answer.reason.value, "message": answer.message}
    if best is not None:
        facts |= {
            "off_um": numbers(best.shift_um), "turn_deg": number(best.turn_deg), "target_px": numbers(best.target_px),
            "sigma_px": number(best.sigma_px), "agreement": number(best.agreement), "log_odds": number(best.log_odds),
            "edges_confirmed": number(best.near.confirmed), "edges_contradicted": number(best.near.contradicted),
            "rivals": [{"target_um": numbers(r.target_um), "log_odds": number(r.log_odds)} for r in best.rivals[:5]],
        }  # fmt: skip
    return facts


def board_table(look: BoardLook) -> Table:
    """Return the same for people."""
    table = Table(title="board by its CAD", show_header=False)
    for name, value in board_facts(look).items():
        if name not in ("found", "message", "reason"):
            table.add_row(name.replace("_", " "), escape(json.dumps(value)))
    return table


def _load_board(path: Path) -> Board:
    try:
        board = Board.load(path)
    except ValueError as exc:
        fail(str(exc), code=USAGE)
    if board.layers is None:
        fail(f"{path}: {NO_LAYERS}", code=USAGE)
    return board


def _place(board: Board, at: str) -> tuple[tuple[float, float], BoardPoint | None]:
    if "," in at:
        return point_option(at, "--at"), None
    try:
        point = board.find(at)
    except Fault as fault:
        fail(fault.message, advice="give --at a target of the board file, or X,Y on the board in um", code=USAGE)
    return point.place_um, point


def _load_map(path: Path) -> PoseMap:
    """Read a map as the station keeps it, or the map alone."""
    try:
        raw = json.loads(path.read_text(encoding="utf-8"))
        return PoseMap.from_json(json.dumps(raw.get("pose_map", raw)))
    except OSError as exc:
        fail(
            f"cannot read {path}: {exc.strerror}",
            advice="a station keeps it as calibration/map.json",
            code=USAGE,
        )
    except (ValueError, AttributeError) as exc:
        fail(f"{path} is no pose map ({exc})", advice="a station keeps it as calibration/map.json", code=USAGE)


def _board_to_px(
    pose_map: PoseMap, tip_px: tuple[float, float], place_um: tuple[float, float], turn_deg: float
) -> Array:
    """Return the homography for a board whose `place_um` is below the tip; `turn_deg`: of the head over the board."""
    corners = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]) * SPAN_UM
    there = pose_map.to_px(corners, tip_px, turn_deg)
    local: Array = np.asarray(
        cv2.getPerspectiveTransform(corners.astype(np.float32), there.astype(np.float32)), dtype=float
    )
    moved = np.array([[1.0, 0.0, -place_um[0]], [0.0, 1.0, -place_um[1]], [0.0, 0.0, 1.0]])
    whole: Array = local @ moved
    return whole
