"""What an interrupted rotational calibration has measured so far, on disk, so that it can go on."""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from daemon.platform.atomic_file import replace_whole
from daemon.storage.calibration_records import Pair, SeenTarget, Stop

_FILE = "rotation.partial.json"
_RUN = {"station", "probe", "map_made_at", "control_um", "angles"}


class Partial(BaseModel):
    """A run under way: what it stands on, what it is to measure, and what it has."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    station: str
    probe: str
    map_made_at: str
    control_um: Pair
    angles: tuple[float, ...]
    card_height_um: float
    stops: tuple[Stop, ...]
    sightings: tuple[SeenTarget, ...]

    def same_run(self, other: Partial) -> bool:
        """Tell whether both stand on the same station, probe, map, control point and angles."""
        return self.model_dump(include=_RUN) == other.model_dump(include=_RUN)

    def write(self, folder: Path) -> None:
        """Keep it, whole or not at all."""
        text = self.model_dump_json()
        replace_whole(folder / _FILE, lambda path: path.write_text(text))

    @classmethod
    def read(cls, folder: Path) -> Partial | None:
        """Return what is there; a file that cannot be used means to begin anew."""
        try:
            return cls.model_validate_json((folder / _FILE).read_bytes())
        except (OSError, ValidationError):
            return None

    @staticmethod
    def forget(folder: Path) -> None:
        """Drop it: the run came to its end."""
        (folder / _FILE).unlink(missing_ok=True)
