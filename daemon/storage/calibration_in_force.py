"""The calibrations in force: an immutable picture of what is on disk and fits this station and its probe.

A record made on another station or with another probe is not used. What cannot be read is not used either, and the
picture says why.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, TypeVar

import structlog

from daemon.domain.board import Board
from daemon.platform.plain_file import read_small
from daemon.storage.alignment_void import Void, read_void
from daemon.storage.calibration_conditions import Conditions, dated_in_the_future
from daemon.storage.calibration_records import (
    MOST_BYTES,
    AlignmentRecord,
    MapRecord,
    Record,
    RotationRecord,
    SurfaceRecord,
    read_record,
    record_file,
)
from vision import ProbeModel
from vision.geometry import PoseMap, Surface
from vision.head import Head, head_from_dict

KINDS: Final = ("map", "rotation", "surface", "backlash", "alignment")
OF_THE_PROBE: Final = ("map", "rotation", "surface")
"""What a new probe makes void: its tip lies elsewhere and at another height."""
_V = TypeVar("_V")
log = structlog.get_logger(__name__)


@dataclass(frozen=True, eq=False)
class InForce:
    """What is calibrated at one moment; it never changes, so that a reader sees one state only."""

    station: str
    conditions: Conditions | None = None
    """What the station is set to; None where nobody has said so, then nothing is judged by it."""
    probe: ProbeModel | None = None
    fingerprint: str = ""
    """Of the taught probe; records made with another one are not used."""
    pose_map: PoseMap | None = None
    head: Head | None = None
    surface: Surface | None = None
    records: Mapping[str, Record] = field(default_factory=lambda: MappingProxyType({}))
    """Kind -> record."""
    problems: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    """Kind -> why its file is not used."""
    void: Void | None = None
    """Why no correction may be made until the board is aligned; None if it may."""

    @property
    def mapped_at(self) -> str | None:
        """When the map was made."""
        return self.records["map"].made_at if "map" in self.records else None

    def made_at(self) -> dict[str, str]:
        """Return kind -> when it was made."""
        return {what: record.made_at for what, record in self.records.items()}

    def alignment(self, board: Board) -> AlignmentRecord | None:
        """Return where the board was seen to lie, if it is this board."""
        record = self.records.get("alignment")
        if isinstance(record, AlignmentRecord) and (record.board, record.side) == (board.name, board.side):
            return record
        return None

    def with_record(self, record: Record) -> InForce:
        """Return what is in force with this record; ValueError if it is of another station or probe, or damaged."""
        if record.station != self.station:
            raise ValueError(f"it was made on station {record.station!r}, this is {self.station!r}")
        if record.what in OF_THE_PROBE and record.probe != self.fingerprint:
            raise ValueError("it was made with another probe")
        unfit = dated_in_the_future(record.made_at)
        if self.conditions is not None and record.conditions is not None:
            unfit = unfit or self.conditions.against(record.what, record.conditions)
        if unfit is not None:
            raise ValueError(unfit)
        return replace(
            self,
            records=MappingProxyType({**self.records, record.what: record}),
            problems=_without(self.problems, record.what),
            void=None if record.what == "alignment" else self.void,
            **_carried(record),
        )

    def with_probe(self, probe: ProbeModel, fingerprint: str) -> InForce:
        """Return what is in force with this probe: map, head and surface of the one before are void."""
        return replace(
            self,
            probe=probe,
            fingerprint=fingerprint,
            pose_map=None,
            head=None,
            surface=None,
            records=_without(self.records, *OF_THE_PROBE),
            problems=_without(self.problems, "probe", *OF_THE_PROBE),
        )

    def without_alignment(self, void: Void) -> InForce:
        """Return the same without the board's alignment, which is void."""
        return replace(self, records=_without(self.records, "alignment"), void=void).with_problem("alignment", void.why)

    def with_problem(self, what: str, why: str) -> InForce:
        """Return the same with a reason why a kind's file is not used."""
        return replace(self, problems=MappingProxyType({**self.problems, what: why}))


def probe_file(folder: Path) -> Path:
    """Return where the taught probe is kept."""
    return folder / "probe.npz"


def read_in_force(folder: Path, station: str, conditions: Conditions | None = None) -> InForce:
    """Read what is there. A missing file is simply not calibrated yet; of an unusable one it is said why."""
    found = InForce(station, conditions)
    try:
        if probe_file(folder).exists():
            found = found.with_probe(*read_probe(probe_file(folder)))
    except (ValueError, OSError) as exc:
        found = _skip(found, "probe", exc)
    for what in KINDS:
        found = with_file(found, folder, what)
    void = read_void(folder)
    return found.without_alignment(void) if void is not None else found


def with_file(found: InForce, folder: Path, what: str) -> InForce:
    """Return what is in force with the file of one kind, or with why that is not used; the same if there is none."""
    file = record_file(folder, what)
    try:
        if not file.exists():
            return found
        record = read_record(file)
        if record.what != what:
            raise ValueError(f"{file.name} holds a calibration of another kind ({record.what})")
        return found.with_record(record)
    except (ValueError, OSError) as exc:
        return _skip(found, what, exc)


def read_probe(file: Path) -> tuple[ProbeModel, str]:
    """Return a probe and its fingerprint; ValueError if the file holds none, OSError if it cannot be read."""
    content = read_small(file, MOST_BYTES)  # before anybody else opens it: a pipe would be waited for without end
    return ProbeModel.load(file), hashlib.sha256(content).hexdigest()[:16]


def _skip(found: InForce, what: str, why: Exception) -> InForce:
    log.warning("calibration_not_used", what=what, why=str(why))
    return found.with_problem(what, str(why))


def _carried(record: Record) -> dict[str, Any]:
    """Return what a record carries, as it is worked with; ValueError if that is damaged."""
    match record:
        case MapRecord():
            return {"pose_map": PoseMap.from_json(json.dumps(record.pose_map))}
        case RotationRecord():
            return {"head": head_from_dict(record.head)}
        case SurfaceRecord():
            return {"surface": Surface.from_dict(record.surface)}
        case _:
            return {}


def _without(values: Mapping[str, _V], *names: str) -> Mapping[str, _V]:
    return MappingProxyType({name: value for name, value in values.items() if name not in names})
