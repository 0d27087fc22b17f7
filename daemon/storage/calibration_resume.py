"""Resume file of an interrupted rotational calibration: what it has measured so far."""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from daemon.platform.atomic_file import FOR_THE_GROUP, replace_whole
from daemon.platform.plain_file import read_small
from daemon.storage.calibration_records import (
    MOST_BYTES,
    Pair,
    RotationRecord,
    SeenTarget,
    Stop,
    read_record,
    record_file,
)

_FILE = "rotation.partial.json"
_RUN = {"station", "probe", "map_made_at", "control_um", "angles"}


class Spent(BaseModel):
    """What a run took in all its legs so far; a leg ends where the run was interrupted."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    seconds: float = 0.0
    looks: int = 0
    legs: int = 0


class Partial(BaseModel):
    """A run under way: what it depends on, what it is to measure, and what it has measured."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    station: str
    probe: str
    map_made_at: str
    control_um: Pair
    angles: tuple[float, ...]
    card_height_um: float
    stops: tuple[Stop, ...]
    sightings: tuple[SeenTarget, ...]
    spent: Spent = Spent()

    def same_run(self, other: Partial) -> bool:
        """Tell whether both are of the same station, probe, map, control point and angles."""
        return self.model_dump(include=_RUN) == other.model_dump(include=_RUN)

    def write(self, folder: Path) -> None:
        """Keep it, whole or not at all; OSError if it cannot be written."""
        text = self.model_dump_json()
        replace_whole(folder / _FILE, lambda path: path.write_text(text, encoding="utf-8"), FOR_THE_GROUP)

    @classmethod
    def read(cls, folder: Path) -> Partial | None:
        """Return what an interrupted run left; None if there is nothing usable, or the run came to its end.

        A run whose stops are those of the present rotation is over, even if its file could not be removed.
        """
        try:
            left = cls.model_validate_json(read_small(folder / _FILE, MOST_BYTES))
        except (OSError, ValidationError):
            return None
        return None if left.is_over(folder) else left

    def is_over(self, folder: Path) -> bool:
        """Tell whether the present rotation is the end of this run."""
        try:
            present = read_record(record_file(folder, "rotation"))
        except (OSError, ValueError):
            return False
        return isinstance(present, RotationRecord) and bool(self.stops) and present.stops == self.stops

    @staticmethod
    def forget(folder: Path) -> None:
        """Drop it: the run came to its end. OSError if it cannot be removed."""
        (folder / _FILE).unlink(missing_ok=True)
