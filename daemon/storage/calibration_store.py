"""Calibration store: probe, map, head, surface, alignment; in files, replaced whole or not at all.

A calibration is in force only when it is on disk. The new file is written beside and flushed, the old one gets a second
name in `history/`, and one rename makes the new one the present one; only then does memory change, by one assignment.
So a reader, a kill or a full disk between any two steps finds the old calibration or the new one, whole.
"""

from __future__ import annotations

import shlex
import threading
import zipfile
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from uuid import uuid4

import structlog

from daemon.domain.board import Board
from daemon.domain.errors import Fault, FaultCode
from daemon.platform.atomic_file import FOR_THE_GROUP, flush_folder, written_beside
from daemon.platform.clock import utc_now
from daemon.storage import alignment_void
from daemon.storage.alignment_void import Void
from daemon.storage.calibration_conditions import Conditions
from daemon.storage.calibration_history import History, Kept
from daemon.storage.calibration_in_force import (
    OF_THE_PROBE,
    InForce,
    probe_file,
    read_in_force,
    read_probe,
    with_file,
)
from daemon.storage.calibration_records import AlignmentRecord, Record, parse_record, record_file
from daemon.storage.calibration_resume import Partial
from vision import ProbeModel
from vision.geometry import PoseMap, Surface
from vision.head import Head

log = structlog.get_logger(__name__)


class Calibrations:
    """Hold what is calibrated at present; read once at start, written when a calibration succeeds.

    `in_force` is assigned whole and never changed, so every thread may read it. `load`, `store` and `store_probe` block
    on the disk: they are for a worker thread.
    """

    def __init__(self, folder: Path, station: str) -> None:
        self.folder = folder
        self.in_force = InForce(station)
        self._history = History(folder / "history")
        self._writing = threading.Lock()

    def file(self, what: str) -> Path:
        """Return where the present record of a kind is kept."""
        return record_file(self.folder, what)

    # --- reading and writing ------------------------------------------------------------------------------------

    def load(self) -> None:
        """Read what is there. A missing file is simply not calibrated yet; of an unusable one it is said why."""
        with self._writing:
            self.in_force = read_in_force(self.folder, self.in_force.station, self.in_force.conditions)

    def fit_to(self, conditions: Conditions) -> None:
        """Take over what the station is set to, and read again what was measured for just that."""
        with self._writing:
            self.in_force = read_in_force(self.folder, self.in_force.station, conditions)

    def void_alignment(self, void: Void) -> None:
        """Use no alignment, and allow no correction, until one passes; on disk first. Raises OSError."""
        with self._writing:
            alignment_void.write_void(self.folder, void)
            self.in_force = self.in_force.without_alignment(void)

    def store(self, record: Record) -> Path | None:
        """Put a record on disk and in force; return where the one it replaces is kept, if there was one.

        Raises ValueError if the record could not be used afterwards, OSError if it cannot be written; what was in force
        then stays so, on disk and in memory.
        """
        file, text = self.file(record.what), record.model_dump_json(indent=1)
        with self._writing:
            # What a later start will read is judged and taken, not what was meant to be written.
            new = self.in_force.with_record(parse_record(text, file.name))
            with written_beside(file, lambda path: path.write_text(text, encoding="utf-8"), FOR_THE_GROUP) as beside:
                (kept,) = self._replace(file, beside, [file])
            self.in_force = new
            self._history.prune(record.what)
            if record.what == "rotation":
                self._end_run()
            if record.what == "alignment":
                self._end_void()
            return kept.path if kept else None

    def store_probe(self, model: ProbeModel) -> None:
        """Put a taught probe on disk and in force; what was calibrated with another one is void, and in the history.

        The probe's own file decides: from its rename on, records that bear another fingerprint are not used, whether
        they could be removed or not. Raises ValueError and OSError as `store` does.
        """
        file, void = probe_file(self.folder), [self.file(what) for what in OF_THE_PROBE]
        with self._writing:
            with written_beside(file, lambda path: _write_probe(model, path), FOR_THE_GROUP) as beside:
                new = self.in_force.with_probe(*read_probe(beside))
                self._replace(file, beside, void)
            for what in OF_THE_PROBE:
                self._remove_void(self.file(what))
                new = with_file(new, self.folder, what)
                self._history.prune(what)
            self.in_force = new

    def _replace(self, file: Path, beside: Path, old: Sequence[Path]) -> list[Kept | None]:
        """Keep the `old` files in the history, then put `beside` in the place of `file`; all of it or nothing."""
        kept: list[Kept | None] = []
        try:
            for one in old:
                kept.append(self._history.add(one))  # noqa: PERF401  # what was added before a failure is taken back
            beside.replace(file)
        except OSError:
            for added in filter(None, kept):
                self._history.take_back(added)
            raise
        try:
            flush_folder(self.folder)
        except OSError as exc:
            # Every reader sees the new file from here on; after a power cut it may be the old one, as whole.
            log.error("calibration_not_flushed", file=str(file), why=str(exc))
        return kept

    def _remove_void(self, file: Path) -> None:
        """Remove a record of another probe; if it cannot be removed it is still not used."""
        try:
            file.unlink(missing_ok=True)
        except OSError as exc:
            log.warning("void_calibration_not_removed", file=str(file), why=str(exc))

    def _end_run(self) -> None:
        """Forget what the run measured; if that cannot be removed, `Partial.read` knows it for over."""
        try:
            Partial.forget(self.folder)
        except OSError as exc:
            log.warning("run_not_forgotten", why=str(exc))

    def _end_void(self) -> None:
        """Forget that the alignment before this one was void; if that stays written, it is not of this one."""
        try:
            alignment_void.forget(self.folder)
        except OSError as exc:
            log.warning("void_not_forgotten", why=str(exc))

    # --- asking -----------------------------------------------------------------------------------------------

    @property
    def probe(self) -> ProbeModel | None:
        """The taught probe."""
        return self.in_force.probe

    @property
    def fingerprint(self) -> str:
        """Of the taught probe; records made with another one are not used."""
        return self.in_force.fingerprint

    @property
    def pose_map(self) -> PoseMap | None:
        """The map from image to robot."""
        return self.in_force.pose_map

    @property
    def head(self) -> Head | None:
        """The model of the head's rotation."""
        return self.in_force.head

    @property
    def surface(self) -> Surface | None:
        """The plane below the probe."""
        return self.in_force.surface

    @property
    def records(self) -> Mapping[str, Record]:
        """Kind -> record in force."""
        return self.in_force.records

    @property
    def problems(self) -> dict[str, str]:
        """Kind -> why its file is not used."""
        return dict(self.in_force.problems)

    @property
    def mapped_at(self) -> str | None:
        """When the map was made."""
        return self.in_force.mapped_at

    def made_at(self) -> dict[str, str]:
        """Return kind -> when it was made, for what is in force."""
        return self.in_force.made_at()

    def alignment(self, board: Board) -> AlignmentRecord | None:
        """Return where the board was seen to lie, if it is this board."""
        return self.in_force.alignment(board)

    def require_board(self, board: Board, board_id: str | None) -> None:
        """Raise `Fault` if the board in the nest, by its id if the client gave one, has to be aligned first."""
        void, aligned = self.in_force.void, self.in_force.alignment(board)
        if void is not None:
            why = f"nothing is corrected or touched before the board is aligned: {void.why}"
            board_id = board_id or void.board_id
        elif board_id is not None and (aligned is None or aligned.board_id != board_id):
            why = f"board {board_id} has not been aligned"
        else:
            return
        if board_id is None:
            raise Fault(FaultCode.NOT_ALIGNED, why)
        # Aligned without its id it would be refused to the next who names it.
        advice = f"send `align` for it (`board_id`, typed --board-id {shlex.quote(board_id)}); see that it lies flat"
        raise Fault(FaultCode.NOT_ALIGNED, why, advice=advice, board_id=board_id)

    def require_probe(self) -> ProbeModel:
        """Return the taught probe or say that there is none."""
        now = self.in_force
        if now.probe is None:
            raise Fault(FaultCode.NOT_CALIBRATED, _why(now, "probe", "the probe's tip has not been taught"))
        return now.probe

    def require_map(self, max_age_days: float, work_z_um: float) -> PoseMap:
        """Return the pose map if it is there, young enough and made at this working height."""
        now = self.in_force
        if now.pose_map is None or now.mapped_at is None:
            raise _no_map(_why(now, "map", "the map from image to robot has not been calibrated"))
        age = datetime.now(UTC) - datetime.fromisoformat(now.mapped_at)
        if age.total_seconds() > max_age_days * 86400:
            raise _no_map(f"the map is {age.days} days old", made_at=now.mapped_at)
        if abs(now.pose_map.work_z_um - work_z_um) > 1.0:
            raise _no_map("the map was made at another working height", was=now.pose_map.work_z_um)
        return now.pose_map


def _why(now: InForce, what: str, fact: str) -> str:
    why = now.problems.get(what)
    return f"{fact}: {why}" if why else fact


def _no_map(message: str, **detail: object) -> Fault:
    """Return that the map alone is wanted: a tip that is taught stays."""
    return Fault(FaultCode.NOT_CALIBRATED, message, advice="`calibrate map`", **detail)


def _write_probe(model: ProbeModel, path: Path) -> None:
    """Write a probe with the moment it was taught, so that no two have one fingerprint.

    What was calibrated before is void even if the same picture is taught twice.
    """
    model.save(path)
    with path.open("r+b") as file, zipfile.ZipFile(file, "a") as archive:
        archive.writestr("taught.txt", f"{utc_now()} {uuid4().hex}\n")
