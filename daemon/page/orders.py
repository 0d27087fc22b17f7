"""Orders a person may give at the page: which role each needs, and what it becomes on the wire.

The page refuses what a role may not; the daemon, asked with the key of that role, refuses it a second time.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from daemon.domain.roles import ROLES, Role
from daemon.page.plan_table import plan_csv

NAME: Final = re.compile(r"[\w.+:/@#-]{1,64}")
"""Of a board, a point or a plan."""
PLAN: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.+-]{0,63}")
"""Of a plan that is to be stored."""
KEY: Final = re.compile(r"[a-z]+-[0-9a-f-]{8,40}")
"""Of a job that a page starts: an order that is sent twice is carried out once."""


CALIBRATED: Final = ("map", "rotation", "backlash", "surface")
MOST_JOG_UM, MOST_JOG_DEG = 1000.0, 5.0
JOG_MS: Final = 10_000
"""A step that could not begin by then is not taken later."""
LAMP_MS: Final = 20_000
"""A lamp that a person switched on burns for so long."""


class BadOrder(ValueError):
    """What was sent is no order."""


@dataclass(frozen=True)
class Order:
    """One order."""

    op: str
    role: Role
    fields: Callable[[Mapping[str, Any]], dict[str, Any]]
    """What of the body goes out; raises `BadOrder`."""


def may(role: Role, least: Role) -> bool:
    """Tell whether a role is enough."""
    return ROLES.index(role) >= ROLES.index(least)


def asked(body: object) -> tuple[Order, Mapping[str, Any]]:
    """Return the order that a body names, and its body; raise `BadOrder`."""
    if not isinstance(body, dict):
        raise BadOrder("no object")
    order = ORDERS.get(body["order"]) if isinstance(body.get("order"), str) else None
    if order is None:
        raise BadOrder("no such order")
    return order, body


def _nothing(_body: Mapping[str, Any]) -> dict[str, Any]:
    return {}


def _job(body: Mapping[str, Any]) -> dict[str, Any]:
    key = body.get("id")
    if not isinstance(key, str) or not KEY.fullmatch(key):
        raise BadOrder("a job needs an id")
    return {"id": key}


def _acknowledge(body: Mapping[str, Any]) -> dict[str, Any]:
    alert, note = body.get("alert"), body.get("note", "")
    if not isinstance(alert, str) or not isinstance(note, str) or len(note) > 500:
        raise BadOrder("an alert and a note of at most 500 letters")
    return {"alert": alert, "note": note}


def _mended(body: Mapping[str, Any]) -> dict[str, Any]:
    return {**_acknowledge(body), "mended": True}


def _lamp(body: Mapping[str, Any]) -> dict[str, Any]:
    colour = body.get("colour")
    if colour not in ("white", "red", "off"):
        raise BadOrder("a colour: white, red or off")
    return {"colour": colour, "lease_ms": LAMP_MS}


def _name(body: Mapping[str, Any], field: str) -> str:
    value = body.get(field)
    if not isinstance(value, str) or not NAME.fullmatch(value):
        raise BadOrder(f"{field}: at most 64 letters, digits or . + : / @ # - _")
    return value


def _run(body: Mapping[str, Any]) -> dict[str, Any]:
    """Start a run, resume one, or abandon one and start another in its place."""
    fields = _job(body) | {"board_id": _name(body, "board_id")}
    how = body.get("how", "begin")
    if how == "resume":
        return fields | {"resume": True}
    if how not in ("begin", "abandon"):
        raise BadOrder("how: begin, resume or abandon")
    return fields | {"plan": _name(body, "plan")} | ({"abandon": True} if how == "abandon" else {})


def _align(body: Mapping[str, Any]) -> dict[str, Any]:
    return _job(body) | {"board_id": _name(body, "board_id")}


def _mark(body: Mapping[str, Any]) -> dict[str, Any]:
    mark, reason = body.get("mark"), body.get("note")
    if mark not in ("forbidden", "approved"):
        raise BadOrder("a mark: forbidden or approved")
    if not isinstance(reason, str) or not reason.strip() or len(reason) > 300:
        raise BadOrder("a reason of at most 300 letters")
    return {"test_point": _name(body, "test_point"), "mark": mark, "reason": reason}


def _at_point(body: Mapping[str, Any]) -> dict[str, Any]:
    return _job(body) | {"test_point": _name(body, "test_point")}


def _look(body: Mapping[str, Any]) -> dict[str, Any]:
    return _job(body) | {"pictures": True}


def _teach(body: Mapping[str, Any]) -> dict[str, Any]:
    place = body.get("tip_px")
    if not isinstance(place, list) or len(place) != 2 or not all(_is_number(one, 1e5) for one in place):
        raise BadOrder("a place in the picture, px")
    return _job(body) | {"what": "tip", "tip_px": [float(one) for one in place]}


def _plan(action: str) -> Callable[[Mapping[str, Any]], dict[str, Any]]:
    """Return what checks or stores a plan that was edited as a table."""

    def fields(body: Mapping[str, Any]) -> dict[str, Any]:
        name = body.get("name")
        if not isinstance(name, str) or not PLAN.fullmatch(name):
            raise BadOrder("name: at most 64 letters, digits or _ . + -")
        try:
            text = plan_csv(body.get("board"), body.get("tests"))
        except ValueError as exc:
            raise BadOrder(str(exc)) from exc
        return {"action": action, "name": name, "text": text, "form": "csv"}

    return fields


def _calibrate(body: Mapping[str, Any]) -> dict[str, Any]:
    """Start a calibration that needs no picture touched before."""
    what = body.get("what")
    if what not in CALIBRATED:
        raise BadOrder(f"what: one of {', '.join(CALIBRATED)}")
    fields = _job(body) | {"what": what}
    if "test_point" in body and what in ("map", "backlash"):
        fields["test_point"] = _name(body, "test_point")
    return fields


def _jog(body: Mapping[str, Any]) -> dict[str, Any]:
    axis = body.get("axis")
    if axis not in ("x", "y", "z", "theta"):
        raise BadOrder("an axis: x, y, z or theta")
    unit, most = ("by_deg", MOST_JOG_DEG) if axis == "theta" else ("by_um", MOST_JOG_UM)
    step = body.get(unit)
    if not _is_number(step, most):
        raise BadOrder(f"{unit}: at most {most:g} to either side")
    return _job(body) | {"axis": axis, unit: step, "deadline_ms": JOG_MS}


def _is_number(value: object, most: float) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and -most <= value <= most


ORDERS: Final[Mapping[str, Order]] = {
    "stop": Order("cancel", "operate", _nothing),
    "lift": Order("lift", "operate", _job),
    "run": Order("run", "operate", _run),
    "align": Order("align", "operate", _align),
    "pause": Order("pause", "operate", _nothing),
    "check_plan": Order("plan", "operate", _plan("check")),
    "store_plan": Order("plan", "maintain", _plan("store")),
    "mark": Order("mark", "operate", _mark),
    "place": Order("place", "operate", _at_point),
    "correct": Order("correct", "operate", _at_point),
    "probe": Order("probe", "operate", _at_point),
    "look": Order("look", "operate", _look),
    "teach": Order("calibrate", "maintain", _teach),
    "calibrate": Order("calibrate", "maintain", _calibrate),
    "jog": Order("jog", "maintain", _jog),
    "light": Order("light", "operate", _lamp),
    "acknowledge": Order("acknowledge", "operate", _acknowledge),
    "mended": Order("acknowledge", "maintain", _mended),
    "reset": Order("reset", "maintain", _nothing),
    "home": Order("home", "maintain", _job),
}
"""By the word a browser uses."""
