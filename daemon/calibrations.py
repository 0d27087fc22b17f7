"""What the station has learned: the probe's model and the pose map, kept in files, replaced whole or not at all."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path

from daemon.clock import utc_now
from daemon.faults import Fault, Kind
from daemon.files import replace_whole
from vision import ProbeModel
from vision.posemap import PoseMap

MAP_FORMAT = "reprobe-calibration-1"


class Calibrations:
    """Hold the present probe model and pose map; read once at start, written when a calibration succeeds."""

    def __init__(self, folder: Path, station: str) -> None:
        self._folder = folder
        self._station = station
        self.probe: ProbeModel | None = None
        self.pose_map: PoseMap | None = None
        self.mapped_at: str | None = None

    @property
    def _probe_file(self) -> Path:
        return self._folder / "probe.npz"

    @property
    def _map_file(self) -> Path:
        return self._folder / "posemap.json"

    def load(self) -> None:
        """Read what is there; an unreadable file is a `Fault`, a missing one is simply not taught yet."""
        try:
            if self._probe_file.exists():
                self.probe = ProbeModel.load(self._probe_file)
            if self._map_file.exists():
                self._read_map()
        except (ValueError, OSError) as exc:
            raise Fault(Kind.NOT_CALIBRATED, f"a calibration cannot be read: {exc}") from exc

    def _read_map(self) -> None:
        raw = json.loads(self._map_file.read_text())
        if not isinstance(raw, dict) or raw.get("format") != MAP_FORMAT:
            raise ValueError(f"{self._map_file.name} is not a calibration of this program")
        if raw["station"] != self._station:
            raise ValueError(f"{self._map_file.name} was made on station {raw['station']!r}, this is {self._station!r}")
        self.pose_map = PoseMap.from_json(json.dumps(raw["map"]))
        self.mapped_at = str(raw["made_at"])

    def store_probe(self, model: ProbeModel) -> None:
        """Keep a taught probe; a map made with another probe no longer holds and is dropped."""
        replace_whole(self._probe_file, model.save)
        self.probe = model
        self._map_file.unlink(missing_ok=True)
        self.pose_map = self.mapped_at = None

    def store_map(self, pose_map: PoseMap) -> None:
        """Keep a fitted map with its date and the station it belongs to."""
        made_at = utc_now()
        record = {"format": MAP_FORMAT, "made_at": made_at, "station": self._station}
        text = json.dumps(record | {"map": json.loads(pose_map.to_json())}, indent=1)
        replace_whole(self._map_file, lambda path: path.write_text(text))
        self.pose_map, self.mapped_at = pose_map, made_at

    def require_probe(self) -> ProbeModel:
        """Return the taught probe or say that there is none."""
        if self.probe is None:
            raise Fault(Kind.NOT_CALIBRATED, "the probe's tip has not been taught")
        return self.probe

    def require_map(self, max_age_days: float, work_z_um: float) -> PoseMap:
        """Return the pose map if it is there, young enough and made at this working height."""
        if self.pose_map is None or self.mapped_at is None:
            raise Fault(Kind.NOT_CALIBRATED, "the map from image to robot has not been calibrated")
        age = datetime.now(UTC) - datetime.fromisoformat(self.mapped_at)
        if age.total_seconds() > max_age_days * 86400:
            raise Fault(Kind.NOT_CALIBRATED, f"the map is {age.days} days old", made_at=self.mapped_at)
        if abs(self.pose_map.work_z_um - work_z_um) > 1.0:
            raise Fault(Kind.NOT_CALIBRATED, "the map was made at another working height", was=self.pose_map.work_z_um)
        return self.pose_map
