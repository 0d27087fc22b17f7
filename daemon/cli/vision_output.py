"""Output of vision: JSON with stable keys, and tables; every number's unit is in its name."""

from __future__ import annotations

import math
import re
from typing import Any

from rich.table import Table

from vision import RULES, ControlPoint, Decided, NotFound, ProbeModel, Seen, TestPoint, Tip

DIGITS = 4


def _in_short(doc: str | None) -> str:
    """Return what a rule's docstring says, without its sources and reasons."""
    first = (doc or "").split("\n")[0]
    return re.sub(r" \([^)]*\)", "", first).split(": ")[0].rstrip(".")


SAYS = {rule.__name__: _in_short(rule.__doc__) for rule in RULES} | {
    "overlapped": "Throw a circle that lies on a better seen one",
    "no_rule": "Nothing decides it",
}
"""What each rule says, for the tables."""


def number(value: float) -> float | None:
    """Return a number for JSON, rounded; None for what JSON cannot hold."""
    return round(float(value), DIGITS) if math.isfinite(value) else None


def numbers(values: tuple[float, ...]) -> list[float | None]:
    """Return numbers for JSON."""
    return [number(value) for value in values]


def missing(found: NotFound) -> dict[str, Any]:
    """Return why there is nothing."""
    return {"found": False, "reason": found.reason.value, "message": found.message}


def tip_facts(tip: Tip | NotFound, model: ProbeModel) -> dict[str, Any]:
    """Return a tip for JSON."""
    if isinstance(tip, NotFound):
        return missing(tip)
    plain = ("x_px", "y_px", "sigma_px", "marking_contrast", "width_px", "bend_px", "score", "edge_support")
    return {
        "found": True,
        **{name: number(getattr(tip, name)) for name in plain},
        "angle_deg": number(math.degrees(tip.angle_rad)),
        "sharpness_per_px": number(tip.sharpness),
        "from_taught_px": numbers((tip.x_px - model.tip_px[0], tip.y_px - model.tip_px[1])),
        "rim1_px": numbers(tip.rim1_px),
        "rim2_px": numbers(tip.rim2_px),
        "edges_meet_px": numbers(tip.intersection_px),
        "edges": [
            {
                "x_px": number(line.x_px),
                "y_px": number(line.y_px),
                "angle_deg": number(math.degrees(line.angle_rad)),
                "sigma_px": number(line.sigma_px),
                "used": int(line.used),
                "offered": int(line.offered),
            }
            for line in tip.edges
        ],
    }


def seen_facts(seen: Seen, around_px: tuple[float, float]) -> dict[str, Any]:
    """Return what was seen round a point for JSON."""
    if isinstance(seen.nearest, NotFound):
        answer = missing(seen.nearest) | {"nearest": None}
    else:
        answer = {"found": True, "nearest": point_facts(seen.nearest, around_px)}
    return {
        **answer,
        "around_px": numbers(around_px),
        "window_px": dict(zip(("x", "y", "width", "height"), (int(edge) for edge in seen.window_px), strict=True)),
        "taken": [point_facts(point, around_px) for point in seen.taken],
        "thrown": [object_facts(item) for item in seen.thrown],
        "undecided": [object_facts(item) for item in seen.undecided],
    }


def point_facts(point: TestPoint, around_px: tuple[float, float]) -> dict[str, Any]:
    """Return a test point for JSON."""
    way = point.x_px - around_px[0], point.y_px - around_px[1]
    return {
        "kind": point.kind,
        "rule": point.rule,
        "x_px": number(point.x_px),
        "y_px": number(point.y_px),
        "sigma_px": number(point.sigma_px),
        "radius_px": number(point.radius_px),
        "pad_px": numbers(point.pad_px),
        "hole_px": None if point.hole_px is None else numbers(point.hole_px[:2]),
        "hole_radius_px": None if point.hole_px is None else number(point.hole_px[2]),
        "visible": number(point.visible),
        "offset_px": numbers(way),
        "distance_px": number(math.hypot(*way)),
    }


def object_facts(item: Decided) -> dict[str, Any]:
    """Return an object that is no test point for JSON."""
    seen = item.object
    return {
        "rule": item.rule,
        "x_px": number(seen.x_px),
        "y_px": number(seen.y_px),
        "radius_px": None if seen.circle is None else number(seen.circle.radius_px),
        "length_px": number(seen.length_px),
        "thickness_px": number(seen.thickness_px),
        "contrast": number(seen.contrast),
        "distance_px": number(seen.distance_px),
    }


def cross_facts(found: ControlPoint | NotFound) -> dict[str, Any]:
    """Return a control point for JSON."""
    if isinstance(found, NotFound):
        return missing(found)
    arms = [
        {"angle_deg": number(math.degrees(arm.angle_rad)), "width_px": number(arm.width_px), "seen": number(arm.share)}
        for arm in found.arms
    ]
    place = {"x_px": number(found.x_px), "y_px": number(found.y_px), "sigma_px": number(found.sigma_px)}
    return {"found": True, **place, "arms": arms}


def tip_table(tip: Tip, model: ProbeModel) -> Table:
    """Return a tip for people."""
    table = facts_table("tip")
    table.add_row("tip", f"[bold]{_place(tip.x_px, tip.y_px)}[/], 1 sigma {tip.sigma_px:.2f} px")
    dx, dy = tip.x_px - model.tip_px[0], tip.y_px - model.tip_px[1]
    table.add_row("from where it was taught", f"x {dx:+.2f}, y {dy:+.2f} px")
    table.add_row("direction", f"{math.degrees(tip.angle_rad):.2f} deg")
    for name, line in zip(("edge L1", "edge L2"), tip.edges, strict=True):
        where = f"through {_place(line.x_px, line.y_px)} at {math.degrees(line.angle_rad):.2f} deg"
        table.add_row(name, f"{where}, {line.used} of {line.offered} calipers")
    table.add_row("edges would meet at", _place(*tip.intersection_px))
    table.add_row("rims of the marking", f"{_place(*tip.rim1_px)} and {_place(*tip.rim2_px)}")
    table.add_row("marking's contrast", f"{100 * tip.marking_contrast:.0f} %")
    table.add_row("cylinder's width, bend", f"{tip.width_px:.1f} px, {tip.bend_px:+.1f} px at the end")
    quality = f"template {tip.score:.2f}, edges {100 * tip.edge_support:.0f} %, sharpness {tip.sharpness:.2f}/px"
    table.add_row("quality", quality)
    return table


def seen_table(seen: Seen, around_px: tuple[float, float]) -> Table:
    """Return everything that was seen round a point for people, nearest first."""
    table = Table(title=f"round {_place(*around_px)}")
    for column in ("", "rule", "what it says"):
        table.add_column(column)
    for column in ("x px", "y px", "radius px", "away px", "1 sigma px", "visible"):
        table.add_column(column, justify="right")
    rows: list[tuple[float, tuple[str, ...]]] = []
    for point in seen.taken:
        away = math.hypot(point.x_px - around_px[0], point.y_px - around_px[1])
        name = f"[bold green]nearest {point.kind}[/]" if point is seen.nearest else f"[green]{point.kind}[/]"
        measured = (f"{point.radius_px:.2f}", f"{away:.2f}", f"{point.sigma_px:.2f}", f"{100 * point.visible:.0f} %")
        rows.append((away, (name, *_rule(point.rule), f"{point.x_px:.2f}", f"{point.y_px:.2f}", *measured)))
    for items, name in ((seen.undecided, "[magenta]undecided[/]"), (seen.thrown, "[dim]thrown[/]")):
        for item in items:
            thing = item.object
            radius = "" if thing.circle is None else f"{thing.circle.radius_px:.2f}"
            place = (f"{thing.x_px:.2f}", f"{thing.y_px:.2f}")
            rows.append(
                (thing.distance_px, (name, *_rule(item.rule), *place, radius, f"{thing.distance_px:.2f}", "", ""))
            )
    for _, row in sorted(rows, key=lambda row: row[0]):
        table.add_row(*row)
    return table


def cross_table(found: ControlPoint) -> Table:
    """Return a control point for people."""
    table = facts_table("control point")
    table.add_row("centre", f"[bold]{_place(found.x_px, found.y_px)}[/], 1 sigma {found.sigma_px:.2f} px")
    for arm in found.arms:
        facts = f"{arm.width_px:.1f} px wide, {100 * arm.share:.0f} % seen"
        table.add_row("arm", f"towards {math.degrees(arm.angle_rad):.1f} deg, {facts}")
    return table


def facts_table(title: str) -> Table:
    """Return an empty table of names and facts."""
    return Table("", "", title=title, show_header=False)


def _place(x_px: float, y_px: float) -> str:
    return f"({x_px:.2f}, {y_px:.2f}) px"


def _rule(rule: str) -> tuple[str, str]:
    return rule.replace("_", " "), SAYS.get(rule, "")
