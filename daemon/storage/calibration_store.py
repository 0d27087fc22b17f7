"""What the station has learned: probe, map, head, surface, alignment; in files, replaced whole or not at all.

Each kind is one record (`daemon.calibration.records`) beside the probe's model; what it replaces goes to `history/`.
A record made on another station or with another probe is not used. What cannot be read is not used either, and
whoever needs it is told why.
"""

from __future__ import annotations

import hashlib
import json
import re
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import structlog

from daemon.domain.board import Board
from daemon.domain.errors import Fault, FaultCode
from daemon.platform.atomic_file import replace_whole
from daemon.platform.clock import utc_now
from daemon.storage.calibration_records import (
    AlignmentRecord,
    MapRecord,
    Record,
    RotationRecord,
    SurfaceRecord,
    read_record,
)
from vision import ProbeModel
from vision.geometry import PoseMap, Surface
from vision.head import Head, head_from_dict

KINDS: Final = ("map", "rotation", "surface", "backlash", "alignment")
OF_THE_PROBE: Final = ("map", "rotation", "surface")
"""What a new needle makes void: its end lies elsewhere and at another height."""
HISTORY_KEPT = 50
log = structlog.get_logger(__name__)


class Calibrations:
    """Hold what is calibrated at present; read once at start, written when a calibration succeeds."""

    def __init__(self, folder: Path, station: str) -> None:
        self.folder = folder
        self._station = station
        self.probe: ProbeModel | None = None
        self.fingerprint = ""
        """Of the taught probe; records made with another one are not used."""
        self.pose_map: PoseMap | None = None
        self.head: Head | None = None
        self.surface: Surface | None = None
        self.records: dict[str, Record] = {}
        self.problems: dict[str, str] = {}
        """Kind -> why its file is not used."""

    @property
    def _probe_file(self) -> Path:
        return self.folder / "probe.npz"

    def file(self, what: str) -> Path:
        """Return where the present record of a kind is kept."""
        return self.folder / f"{what}.json"

    @property
    def mapped_at(self) -> str | None:
        """When the map was made."""
        return self.records["map"].made_at if "map" in self.records else None

    def made_at(self) -> dict[str, str]:
        """Return kind -> when it was made, for what is in force."""
        return {what: record.made_at for what, record in self.records.items()}

    # --- reading ----------------------------------------------------------------------------------------------

    def load(self) -> None:
        """Read what is there. A missing file is simply not calibrated yet; an unusable one is remembered with why."""
        self.problems = {}
        try:
            if self._probe_file.exists():
                self._take_probe(ProbeModel.load(self._probe_file))
        except (ValueError, OSError) as exc:
            self._skip("probe", exc)
        for what in KINDS:
            try:
                if self.file(what).exists():
                    self._take(self._fitting(read_record(self.file(what))))
            except (ValueError, OSError) as exc:
                self._skip(what, exc)

    def _fitting(self, record: Record) -> Record:
        """Return the record if it belongs to this station and its present probe; else raise ValueError."""
        if record.station != self._station:
            raise ValueError(f"it was made on station {record.station!r}, this is {self._station!r}")
        if record.what in OF_THE_PROBE and record.probe != self.fingerprint:
            raise ValueError("it was made with another probe")
        return record

    def _skip(self, what: str, why: Exception) -> None:
        self.problems[what] = str(why)
        log.warning("calibration_not_used", what=what, why=str(why))

    def _take_probe(self, model: ProbeModel) -> None:
        self.probe = model
        self.fingerprint = hashlib.sha256(self._probe_file.read_bytes()).hexdigest()[:16]

    def _take(self, record: Record) -> None:
        """Put a record in force; raise ValueError if what it carries is damaged."""
        match record:
            case MapRecord():
                self.pose_map = PoseMap.from_json(json.dumps(record.pose_map))
            case RotationRecord():
                self.head = head_from_dict(record.head)
            case SurfaceRecord():
                self.surface = Surface.from_dict(record.surface)
            case _:
                pass
        self.records[record.what] = record
        self.problems.pop(record.what, None)

    # --- writing ----------------------------------------------------------------------------------------------

    def store_probe(self, model: ProbeModel) -> None:
        """Keep a taught probe; what was calibrated with another one no longer holds and goes to the history."""
        replace_whole(self._probe_file, model.save)
        self._take_probe(model)
        self.problems.pop("probe", None)
        for what in OF_THE_PROBE:
            self._retire(what)
            self.records.pop(what, None)
            self.problems.pop(what, None)
        self.pose_map = self.head = self.surface = None

    def store(self, record: Record) -> Path | None:
        """Put a record in force and on disk; return where the one it replaces is kept, if there was one."""
        self._take(record)
        before = self._retire(record.what)
        text = record.model_dump_json(indent=1)
        replace_whole(self.file(record.what), lambda path: path.write_text(text))
        return before

    def _retire(self, what: str) -> Path | None:
        """Move the present file of a kind to the history; return its new place."""
        present = self.file(what)
        if not present.exists():
            return None
        history = self.folder / "history"
        history.mkdir(parents=True, exist_ok=True)
        kept = history / f"{what}-{stamp(utc_now())}.json"
        present.replace(kept)
        for old in sorted(history.glob(f"{what}-*.json"))[:-HISTORY_KEPT]:
            old.unlink(missing_ok=True)
        return kept

    # --- asking -----------------------------------------------------------------------------------------------

    def require_probe(self) -> ProbeModel:
        """Return the taught probe or say that there is none."""
        if self.probe is None:
            raise self._missing("probe", "the probe's tip has not been taught")
        return self.probe

    def require_map(self, max_age_days: float, work_z_um: float) -> PoseMap:
        """Return the pose map if it is there, young enough and made at this working height."""
        if self.pose_map is None or self.mapped_at is None:
            raise self._missing("map", "the map from image to robot has not been calibrated")
        age = datetime.now(UTC) - datetime.fromisoformat(self.mapped_at)
        if age.total_seconds() > max_age_days * 86400:
            raise Fault(FaultCode.NOT_CALIBRATED, f"the map is {age.days} days old", made_at=self.mapped_at)
        if abs(self.pose_map.work_z_um - work_z_um) > 1.0:
            raise Fault(
                FaultCode.NOT_CALIBRATED, "the map was made at another working height", was=self.pose_map.work_z_um
            )
        return self.pose_map

    def alignment(self, board: Board) -> AlignmentRecord | None:
        """Return where the board was seen to lie, if it is this board."""
        record = self.records.get("alignment")
        if isinstance(record, AlignmentRecord) and (record.board, record.side) == (board.name, board.side):
            return record
        return None

    def _missing(self, what: str, fact: str) -> Fault:
        why = self.problems.get(what)
        return Fault(FaultCode.NOT_CALIBRATED, f"{fact}: {why}" if why else fact)


def stamp(utc: str) -> str:
    """Return a moment as part of a file name, sortable."""
    return re.sub(r"[^0-9T]", "", utc.split("+", maxsplit=1)[0])
