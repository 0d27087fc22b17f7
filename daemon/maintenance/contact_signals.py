"""Signals of contact: how points of runs and probes came to their verdicts, and what the reference pad reads. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from daemon.domain.point_test import PointRecord, PointVerdict, Rung
from daemon.maintenance.signals import Numbers

POINTS_A_ROW: Final = 20
"""A run tests a point a second: the journal is not to be filled with rows of one."""
RUNGS: Final = {
    "recovered_by_look": Rung.LOOK, "recovered_by_pump": Rung.PUMP, "recovered_by_reference": Rung.REFERENCE,
    "recovered_by_site": Rung.SECOND_SITE,
}  # fmt: skip
"""Watch -> the rung whose share it follows."""
REFERENCE = "reference pad"
"""What a move's note names when the needle stood there."""


class Contacts:
    """Collects what points say until it is asked for."""

    def __init__(self) -> None:
        self.points = 0
        """Collected since they were last taken."""
        self._events: dict[str, int] = {}
        self._reference_ohm: list[float] = []

    def add(self, record: PointRecord) -> None:
        """Take a point in; one that was not tested says nothing."""
        if record.verdict is PointVerdict.NOT_TESTED:
            return
        self.points += 1
        happened = {
            "first_touch_misses": record.verdict is not PointVerdict.PASS_FIRST,
            "contact_not_made": record.verdict is PointVerdict.CONTACT_NOT_MADE,
            **{name: record.recovered_by is rung for name, rung in RUNGS.items()},
        }
        for name, event in happened.items():
            self._events[name] = self._events.get(name, 0) + event

    def add_step(self, body: Mapping[str, Any]) -> None:
        """Take a note of a move in: what the needle read on the reference pad."""
        ohm = body.get("ohm")
        if body.get("on") == REFERENCE and isinstance(ohm, float | int):
            self._reference_ohm.append(float(ohm))

    @property
    def is_due(self) -> bool:
        """Whether there is enough for a row."""
        return self.points >= POINTS_A_ROW

    def take(self) -> Numbers:
        """Return [events, points] of each share and the readings of the reference pad, and begin anew."""
        numbers: Numbers = {name: [float(events), float(self.points)] for name, events in self._events.items()}
        if self._reference_ohm:
            numbers["reference_ohms"] = self._reference_ohm
        self.points, self._events, self._reference_ohm = 0, {}, []
        return numbers
