"""Vital signs of the running daemon: the numbers that a scrape, a snapshot and the support bundle show.

Reading them costs no I/O but one look at the journal's size, and is safe from another thread: whatever is read is
replaced whole, never changed in place.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from daemon.jobs.fault_latch import FaultLatch
from daemon.station.devices import Hardware
from daemon.storage.calibration_store import Calibrations


@dataclass(frozen=True)
class Vitals:
    """One reading."""

    fault: str | None
    waiting: int
    threads: int
    journal_bytes: int
    calibration_age_s: dict[str, float]
    buses: dict[str, dict[str, int]]
    """Line -> its counts since it was opened, and whether it is connected."""
    camera: dict[str, int]
    """Counts since the camera was opened; empty while there is none."""

    def links(self) -> dict[str, Any]:
        """Return the part about lines and camera, as the wire has it."""
        return {"buses": self.buses, "camera": self.camera}


@dataclass(frozen=True)
class VitalsReader:
    """Where a reading comes from."""

    latch: FaultLatch
    queued: Callable[[], int]
    """How many jobs wait."""
    calibrations: Calibrations
    hardware: Callable[[], Hardware | None]
    """The open devices, None while there are none."""
    data_dir: Path

    def read(self) -> Vitals:
        """Read once; from any thread."""
        fault, hardware = self.latch.fault, self.hardware()
        now = datetime.now(UTC)
        made_at = dict(self.calibrations.made_at())
        return Vitals(
            fault=fault.kind.wire_name if fault else None,
            waiting=self.queued(),
            threads=threading.active_count(),
            journal_bytes=_size(self.data_dir / "journal.sqlite") + _size(self.data_dir / "journal.sqlite-wal"),
            calibration_age_s={k: (now - datetime.fromisoformat(at)).total_seconds() for k, at in made_at.items()},
            buses=_buses(hardware) if hardware else {},
            camera=asdict(hardware.camera.statistics()) if hardware else {},
        )


def _buses(hardware: Hardware) -> dict[str, dict[str, int]]:
    return {
        name: {**asdict(bus.statistics), "reconnects": bus.reconnects, "connected": int(bus.connected)}
        for name, bus in hardware.buses.items()
    }


def _size(file: Path) -> int:
    try:
        return file.stat().st_size
    except OSError:
        return 0
