"""A look at stored images, by the daemon's own functions."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rich.table import Table

from daemon.cli.board_look import BoardAsked, board_facts, board_table, register_board
from daemon.cli.output import USAGE, err, fail
from daemon.cli.picture_files import Pixels, open_picture
from daemon.cli.vision_output import cross_facts, cross_table, seen_facts, seen_table, tip_facts, tip_table
from vision import ControlPoint, NotFound, ProbeModel, Tip, find_control_point, find_test_points, find_tip
from vision.annotate import Searched, draw_board, draw_control_point, draw_look, draw_test_points, draw_tip

PAD_REACH_PX, CROSS_REACH_PX, ARM_PX = 30.0, 60.0, 60.0
NOT_SEARCHED = {
    "found": False,
    "reason": "not_searched",
    "message": "there is no tip to look round; give --around X,Y to look all the same",
}
Point = tuple[float, float]


@dataclass(frozen=True)
class Asked:
    """Hold which pictures are looked at, and what for; None is what was not said."""

    white: Path | None
    red: Path | None
    probe: Path | None
    around_px: Point | None
    control_point: bool
    expected_radius_px: float | None
    expected_hole_radius_px: float | None
    reach_px: float | None
    arm_px: float | None
    board: BoardAsked | None = None

    @property
    def sizes_px(self) -> tuple[float | None, float | None]:
        """Return the pad's radius and its hole's, as they were said."""
        return self.expected_radius_px, self.expected_hole_radius_px

    @property
    def pictures(self) -> list[Path]:
        """Return the pictures that are read."""
        return [path for path in (self.white, self.red) if path is not None]


@dataclass
class StoredLook:
    """Hold facts for JSON by what was looked for, tables for people, and the annotated page."""

    facts: dict[str, dict[str, Any]] = field(default_factory=dict)
    tables: list[Table] = field(default_factory=list)
    page: Pixels | None = None

    @property
    def ok(self) -> bool:
        """Return whether all that was looked for was found."""
        return all(part["found"] for part in self.facts.values())


def look_at(asked: Asked) -> StoredLook:
    """Look for what was asked; ValueError for a number that vision refuses."""
    if asked.board is not None and asked.red is not None:
        return _look_for_board(asked, asked.red, asked.board)
    white = None if asked.white is None else open_picture(asked.white)
    red = None if asked.red is None else open_picture(asked.red)
    findings = StoredLook()
    if asked.control_point:
        if white is not None and asked.around_px is not None:
            _check_inside(white, asked.around_px)
            _look_for_control_point(white, asked.around_px, asked, findings)
        return findings
    if red is not None and asked.around_px is not None:
        _check_inside(red, asked.around_px)
    if white is None or asked.probe is None:
        searched = None if red is None else _look_for_pads(red, asked, None, findings)
        if red is not None and searched is not None:
            findings.page = draw_test_points(red, *searched)
        return findings
    model = _load_probe(asked.probe)
    tip = _look_for_tip(white, model, findings)
    if red is None:
        findings.page = draw_tip(white, tip, taught=model)
    else:
        searched = _look_for_pads(red, asked, tip, findings)
        findings.page = draw_look(white, tip, red, searched, taught=model)
    return findings


def _look_for_board(asked: Asked, red_path: Path, of: BoardAsked) -> StoredLook:
    """Register CAD in the red picture, round the tip of the white one or the point given."""
    red, findings = open_picture(red_path), StoredLook()
    tip: Tip | NotFound | Point | None = asked.around_px
    if tip is None and asked.white is not None and asked.probe is not None:
        tip = _look_for_tip(open_picture(asked.white), _load_probe(asked.probe), findings)
    if tip is None or isinstance(tip, NotFound):
        findings.facts["board"] = dict(NOT_SEARCHED)
        return findings
    look = register_board(red, tip, of)
    findings.facts["board"] = board_facts(look)
    findings.tables.append(board_table(look))
    findings.page = draw_board(red, look)
    return findings


def _look_for_tip(white: Pixels, model: ProbeModel, findings: StoredLook) -> Tip | NotFound:
    size = white.shape[1], white.shape[0]
    if size != model.frame_px:
        taught, given = (f"{width} x {height} px" for width, height in (model.frame_px, size))
        err.print(f"the probe was taught in a picture of {taught}, this one has {given}", style="yellow")
    tip = find_tip(white, model)
    findings.facts["tip"] = tip_facts(tip, model)
    if isinstance(tip, Tip):
        findings.tables.append(tip_table(tip, model))
    return tip


def _look_for_pads(red: Pixels, asked: Asked, tip: Tip | NotFound | None, findings: StoredLook) -> Searched | None:
    """Look for test points round the given point, or else round the tip; None when there is neither."""
    needle = tip if isinstance(tip, Tip) else None
    around = asked.around_px
    if around is None and needle is not None:
        around = needle.x_px, needle.y_px
    if around is None:
        findings.facts["test_points"] = dict(NOT_SEARCHED)
        return None
    reach_px = PAD_REACH_PX if asked.reach_px is None else asked.reach_px
    radius_px, hole_radius_px = asked.sizes_px
    seen = find_test_points(red, around, reach_px, radius_px, needle, expected_hole_radius_px=hole_radius_px)
    findings.facts["test_points"] = seen_facts(seen, around)
    if seen.taken or seen.thrown or seen.undecided:
        findings.tables.append(seen_table(seen, around))
    return Searched(seen, around)


def _look_for_control_point(white: Pixels, around: Point, asked: Asked, findings: StoredLook) -> None:
    reach_px = CROSS_REACH_PX if asked.reach_px is None else asked.reach_px
    arm_px = ARM_PX if asked.arm_px is None else asked.arm_px
    found = find_control_point(white, around, reach_px, arm_px)
    findings.facts["control_point"] = cross_facts(found)
    if isinstance(found, ControlPoint):
        findings.tables.append(cross_table(found))
    findings.page = draw_control_point(white, found, around, reach_px, arm_px)


def _check_inside(picture: Pixels, around: Point) -> None:
    height, width = picture.shape[:2]
    if not (0.0 <= around[0] <= width - 1 and 0.0 <= around[1] <= height - 1):
        fact = f"--around {around[0]:g},{around[1]:g} lies outside the picture"
        fail(fact, advice=f"it has {width} x {height} px", code=USAGE)


def _load_probe(path: Path) -> ProbeModel:
    advice = "teach one with `reprobe teach`"
    try:
        with path.open("rb") as file:
            zipped = zipfile.is_zipfile(file)
        if not zipped:
            fail(f"{path} is no taught probe", advice=advice, code=USAGE)
        return ProbeModel.load(path)
    except OSError as exc:
        fail(f"cannot read {path}: {exc.strerror}", advice=advice, code=USAGE)
