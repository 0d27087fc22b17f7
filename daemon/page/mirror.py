"""Mirror of a station: what the page knows of it, as a pure function of snapshots and events.

Nothing is guessed and no gap is patched: an event whose number is not the next one makes the mirror `stale`, and who
keeps it asks for a snapshot.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, Final

Facts = Mapping[str, Any]
RESULTS_SHOWN: Final = 12
_STATUS: Final = (
    "state", "lifecycle", "fault", "queued", "calibration", "needle", "contact", "touches", "pictures", "links",
    "board_revision", "run",
)  # fmt: skip
"""Parts of a snapshot that are shown as they are; a daemon that is older than the page may not tell all of them."""


@dataclass(frozen=True)
class Station:
    """A station as it was last heard of. Each field is a part of its own for a browser."""

    live: bool = False
    """Whether the daemon is heard; if not, all else is old."""
    lost_why: str = "starting"
    heard_at: str | None = None
    """UTC, ISO 8601: the daemon's time of what was heard last."""
    name: str = ""
    version: str = ""
    state: str = "unknown"
    lifecycle: str = "unknown"
    fault: Facts | None = None
    job: Facts | None = None
    """The job under way: id, op, progress."""
    queued: int = 0
    calibration: Facts | None = None
    needle: Facts | None = None
    contact: Facts | None = None
    touches: int = 0
    pictures: str = ""
    links: Facts | None = None
    board_revision: str = ""
    """Fingerprint of the board file: the map is asked for again when it changes."""
    run: Facts | None = None
    """The newest run over a board, in short."""
    point: Facts | None = None
    """Record of the point that was tested last, while somebody listened."""
    results: tuple[Facts, ...] = ()
    """Newest first."""
    alerts: tuple[Facts, ...] = ()
    """Those that stand, worst first."""
    watches: tuple[Facts, ...] = ()
    next_seq: int = 0
    stale: bool = False
    """An event is missing: a snapshot is needed."""


PRIVATE: Final = frozenset({"next_seq", "stale"})
PARTS: Final = tuple(field.name for field in fields(Station) if field.name not in PRIVATE)


def seen_whole(was: Station, snapshot: Facts, alerts: Facts, history: Facts) -> Station:
    """Return the station of a snapshot, its standing alerts and its last results; nothing older stays."""
    running = snapshot["running"]
    return replace(
        was,
        live=True, lost_why="", stale=False, next_seq=snapshot["next_seq"], name=snapshot["station"],
        version=snapshot["version"], job=dict(running) if running else None,
        results=tuple(history["results"][:RESULTS_SHOWN]), alerts=_sorted(alerts["standing"]),
        watches=tuple(alerts.get("watches", ())), **{part: snapshot[part] for part in _STATUS if part in snapshot},
    )  # fmt: skip


def lost(was: Station, why: str) -> Station:
    """Return a station of which nothing is heard: what was known stays, and says that it is old."""
    return replace(was, live=False, lost_why=why, stale=True)


def after(was: Station, event: Facts) -> Station:
    """Return the station after an event. One that the snapshot held already changes nothing; a gap makes it stale."""
    if was.stale or event["seq"] < was.next_seq:
        return was
    if event["seq"] > was.next_seq:
        return replace(was, stale=True)
    now = replace(was, next_seq=event["seq"] + 1, heard_at=event["time"])
    change = _CHANGES.get(event["topic"])
    return change(now, event) if change is not None else now


def asks_again(event: Facts) -> bool:
    """Whether an event changes more than it says, so that a snapshot is wanted: the needle, the queue, calibrations.

    In fault one cause may follow another without any change of state: each heartbeat asks.
    """
    if event["topic"] == "heartbeat":
        return bool(event["state"] == "fault")
    return event["topic"] == "result" or (event["topic"] == "state" and event["state"] in ("idle", "fault"))


def parts_changed(was: Station | None, now: Station) -> dict[str, Any]:
    """Return the parts that differ, by name; all of them if nothing was known."""
    return {name: getattr(now, name) for name in PARTS if was is None or getattr(was, name) != getattr(now, name)}


def _state(was: Station, event: Facts) -> Station:
    job = was.job
    if event["job"] is None:
        job = None
    elif job is None or job["id"] != event["job"]:
        job = {"id": event["job"], "op": None, "progress": None}
    return replace(was, state=event["state"], fault=event["fault"], job=job)


def _heartbeat(was: Station, event: Facts) -> Station:
    return replace(was, state=event["state"], version=event["version"])


def _result(was: Station, event: Facts) -> Station:
    others = [result for result in was.results if result["id"] != event["id"]]
    job = None if was.job is not None and was.job["id"] == event["id"] else was.job
    return replace(was, job=job, results=(dict(event), *others)[:RESULTS_SHOWN])


def _alert(was: Station, event: Facts) -> Station:
    others = [alert for alert in was.alerts if alert["name"] != event["name"]]
    return replace(was, alerts=_sorted([*others, dict(event)] if event["raised"] else others))


def _progress(was: Station, event: Facts) -> Station:
    told = {name: event[name] for name in ("done", "total", "doing")}
    # The first word of a run: which one it is, the snapshot says.
    begins = event["op"] == "run" and (was.job is None or was.job["progress"] is None or was.job["id"] != event["job"])
    return replace(was, stale=was.stale or begins, job={"id": event["job"], "op": event["op"], "progress": told})


def _contact(was: Station, event: Facts) -> Station:
    return replace(was, contact=dict(event) if event["change"] == "made" else None)


def _point(was: Station, event: Facts) -> Station:
    run = was.run
    if run is not None and event.get("run") == run["id"]:
        run = {**run, "done": run["done"] + 1}
    return replace(was, point=dict(event), run=run)


_CHANGES: Final = {
    "state": _state, "heartbeat": _heartbeat, "result": _result, "alert": _alert, "progress": _progress,
    "contact": _contact, "point": _point,
}  # fmt: skip


def _sorted(alerts: list[Facts]) -> tuple[Facts, ...]:
    """Put the worst first; among equals the one nobody knows of, then the oldest."""
    return tuple(sorted(alerts, key=lambda a: (a["severity"] != "serious", bool(a["acknowledged"]), a["raised_at"])))
