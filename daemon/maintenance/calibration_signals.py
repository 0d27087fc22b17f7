"""Signals of the calibrations: which are in force, how old they are, touches made with the probe."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

import structlog

from daemon.maintenance.signals import Numbers, of_calibrations
from daemon.storage.calibration_records import RotationRecord, read_record
from daemon.storage.calibration_store import Calibrations

WORN_TIMES = 1.25
"""From so many times its life on, an old probe is serious."""
log = structlog.get_logger(__name__)


class Learned:
    """Follow the calibrations of one station."""

    def __init__(self, calibrations: Calibrations) -> None:
        self._calibrations = calibrations
        self._probe: dict[str, Any] = {}
        self._last: dict[str, str] = {}
        self._rotation: tuple[str, RotationRecord | None] = ("", None)

    def bases(self) -> dict[str, str]:
        """Return what restarts watches: kind -> what is in force."""
        made = self._calibrations.made_at()
        bases: dict[str, str] = {
            kind: made[kind] for kind in ("map", "rotation", "surface", "alignment") if kind in made
        }
        if self._calibrations.fingerprint:
            bases["probe"] = self._calibrations.fingerprint
        return bases

    def changed_since_asked(self) -> bool:
        """Tell whether anything is another than when this was last asked."""
        bases = self.bases()
        changed, self._last = bases != self._last, bases
        return changed

    def numbers(self, touches: int, max_age_days: float, probe_life: int) -> Numbers:
        """Return the figures of calibrations and probe."""
        records = self._calibrations.records
        rotation = records.get("rotation")
        before = self._rotation[1] if rotation is not None and self._rotation[0] == rotation.made_at else None
        numbers = of_calibrations(records, before, max_age_days, datetime.now(UTC))
        fingerprint = self._calibrations.fingerprint
        if fingerprint:
            if self._probe.get("fingerprint") != fingerprint:
                self._probe = {"fingerprint": fingerprint, "touches": touches}
            made = touches - int(self._probe["touches"])
            numbers["probe_life"] = [float(made), float(probe_life), WORN_TIMES * probe_life]
        return numbers

    def read_history(self) -> None:
        """Find the rotation that the present one replaced, if it was made with the same probe; once for each.

        Reads files, up to the whole history of a station: for a worker thread.
        """
        present = self._calibrations.records.get("rotation")
        if not isinstance(present, RotationRecord):
            self._rotation = ("", None)
        elif self._rotation[0] != present.made_at:
            self._rotation = (present.made_at, self._read_before(present))

    def _read_before(self, present: RotationRecord) -> RotationRecord | None:
        for file in sorted((self._calibrations.folder / "history").glob("rotation-*.json"), reverse=True):
            try:
                record = read_record(file)
            except (ValueError, OSError) as exc:
                log.debug("history_not_read", file=str(file), why=str(exc))
                continue
            # A writer that was killed may have left a second name of the present one in the history.
            if isinstance(record, RotationRecord) and record.probe == present.probe and record != present:
                return record
        return None

    def to_dict(self) -> dict[str, Any]:
        """Return what has to be remembered: which probe, and at how many touches it came."""
        return self._probe

    def restore(self, stored: Any) -> None:
        """Take over what `to_dict` wrote; anything else is taken for nothing."""
        if isinstance(stored, dict) and isinstance(stored.get("touches"), int):
            self._probe = stored
