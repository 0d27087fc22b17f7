"""Checks of [clearance] against the rest of the configuration: figures that no head or board can have."""

from __future__ import annotations

from collections.abc import Iterator

from daemon.config.problems import Problem
from daemon.config.raw_values import RawValues

TABLE = "clearance"


def clearance_checks(raw: RawValues) -> Iterator[Problem]:
    """Yield every problem; none where the table is left out."""
    if raw.given(TABLE):
        for check in (_outline_of_the_head, _foot_of_the_barrel, _heights_below_the_safe_one, _box):
            yield from check(raw)


def _outline_of_the_head(raw: RawValues) -> Iterator[Problem]:
    """Yield a head that is not thicker the higher it is counted: needle, barrel, the rest."""
    needle, barrel = raw.number(f"{TABLE}.needle_radius_um"), raw.number(f"{TABLE}.barrel_radius_um")
    if needle is not None and barrel is not None and needle > barrel:
        said = f"the needle ({needle:g} um) cannot be thicker than its barrel, barrel_radius_um = {barrel:g}"
        yield f"{TABLE}.needle_radius_um", said
    foot, rest = raw.number(f"{TABLE}.barrel_from_um"), raw.number(f"{TABLE}.head_from_um")
    if foot is not None and rest is not None and rest < foot:
        said = f"the head ({rest:g} um) cannot begin below the barrel's foot, barrel_from_um = {foot:g}"
        yield f"{TABLE}.head_from_um", said


def _foot_of_the_barrel(raw: RawValues) -> Iterator[Problem]:
    """Yield a barrel that would stand on the board when the pin is pushed in as far as is allowed."""
    foot = raw.number(f"{TABLE}.barrel_from_um")
    for path in ("gantry.overtravel_um", "gantry.press_um"):
        pushed = raw.number(path)
        if foot is not None and pushed is not None and foot <= pushed:
            said = f"a barrel {foot:g} um above the needle's end meets the board when the pin is pushed in by {path}"
            yield f"{TABLE}.barrel_from_um", f"{said} = {pushed:g}"
            return


def _heights_below_the_safe_one(raw: RawValues) -> Iterator[Problem]:
    """Yield what would not even be free at the safe height, of which the configuration says that all is."""
    safe, touch = raw.number("gantry.safe_z_um"), raw.number("gantry.touch_z_um")
    if safe is None or touch is None:
        return
    free_um = safe - touch
    names = [f"{TABLE}.{name}" for name in ("clear_um", "solder_um", "lead_um", "nest_um")]
    names += [f"{TABLE}.heights_um.{letters}" for letters in raw.table(f"{TABLE}.heights_um")]
    for name in names:
        height = raw.number(name)
        if raw.given(name) and height is not None and height >= free_um:
            said = f"{height:g} um is not below the safe height, safe_z_um - touch_z_um = {free_um:g} um"
            yield name, f"{said}: one of them is wrong"


def _box(raw: RawValues) -> Iterator[Problem]:
    """Yield a box that is none, or one beside the needle: the needle hangs below the head."""
    box = raw.at(f"{TABLE}.head_box_um")
    if not isinstance(box, list | tuple) or len(box) != 4 or not all(isinstance(v, int | float) for v in box):
        return
    x0, y0, x1, y1 = box
    if not (x0 <= 0.0 <= x1 and y0 <= 0.0 <= y1):
        said = "x0, y0, x1, y1 count from the needle, which hangs below the head: x0 and y0 are 0 or below, x1 and y1"
        yield f"{TABLE}.head_box_um", f"{said} 0 or above"
