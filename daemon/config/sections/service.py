"""Sections of the daemon itself: its name and folder, its doors, what it watches of itself."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Literal, Self

from pydantic import Field, model_validator

from daemon.config.cross_checks import is_endpoint
from daemon.config.sections.base import Positive, Section
from daemon.domain.roles import Role

LOOPBACK = re.compile(r"ipc://.+|tcp://(127(\.\d{1,3}){3}|\[::1\]|localhost)(:(\d+|\*))?")


class StationSection(Section):
    """Who the station is and where it keeps its things."""

    name: str = Field(min_length=1, max_length=64, description="stands in every result and event")
    data_dir: Path = Field(description="journal, pictures, calibrations; relative to the configuration file")
    pictures: Literal["failed", "all", "none"] = Field(default="failed", description="of which jobs pictures are kept")
    pictures_quota_mb: Positive = Field(default=500.0, description="oldest pictures go beyond this")
    needle: str | None = Field(
        default=None,
        min_length=1,
        max_length=64,
        description="serial number of the needle in it; every record tells it",
    )

    @property
    def journal(self) -> Path:
        """Where the journal is kept."""
        return self.data_dir / "journal.sqlite"


def is_local(endpoint: str) -> bool:
    """Whether only this computer reaches an endpoint."""
    return LOOPBACK.fullmatch(endpoint) is not None


class ApiSection(Section):
    """Where testers reach the daemon."""

    control: str = Field(default="tcp://127.0.0.1:5555", description="where is asked, such as tcp://127.0.0.1:5555")
    events: str = Field(default="tcp://127.0.0.1:5556", description="where is told, such as tcp://127.0.0.1:5556")
    live: str = Field(default="", description="where live pictures are published; empty: nowhere")
    live_fps: float = Field(default=5.0, gt=0, le=5.0, description="live pictures a second, while somebody looks")
    max_message_bytes: int = Field(default=1_000_000, ge=1024, description="more is refused before it is decoded")
    queue_length: int = Field(default=16, ge=1, le=1000, description="jobs that may wait")
    queue_per_client: int = Field(default=8, ge=1, le=1000, description="jobs of one client that may wait")
    rate_per_s: Positive = Field(default=2000.0, description="requests of one client, in the long run")
    rate_burst: int = Field(default=2000, ge=1, le=1_000_000, description="requests of one client at once")
    curve: bool = Field(default=False, description="ask every client for a key (CURVE); see `reprobe keys`")
    keys_dir: Path = Field(default=Path("keys"), description="made by `reprobe keys`; relative to this file")
    role: Role = Field(default="maintain", description="of every client, without CURVE")
    heartbeat_s: Positive = Field(default=1.0, description="pace of the heartbeat")

    @model_validator(mode="after")
    def _local(self) -> Self:
        for endpoint in filter(None, (self.control, self.events, self.live)):
            if is_endpoint(endpoint) and not is_local(endpoint) and not self.curve:
                raise ValueError(
                    f"{endpoint} is reachable from outside; only loopback and ipc are served without keys: "
                    "make them by `reprobe keys new`, then set curve = true"
                )
        return self


class MaintenanceSection(Section):
    """What the station watches of itself; `reprobe health` shows it."""

    baseline: int = Field(default=60, ge=10, le=1000, description="numbers from which a chart learns what is usual")
    batch: int = Field(default=5, ge=2, le=50, description="numbers averaged to one point of a chart")
    probe_life_touches: int = Field(default=100_000, ge=100, description="touches after which a probe is to be changed")
    check_s: float = Field(default=300.0, ge=1.0, le=86400.0, description="devices are looked at this often at rest")
    idle_check_s: float = Field(default=2.0, gt=0, le=60.0, description="pause between two checks of drives at rest")
    idle_check_within_s: float = Field(
        default=2.0, gt=0, le=60.0, description="what one check may take beside the time of its requests on the line"
    )
    keep_rows: int = Field(default=60_000, ge=1000, le=10_000_000, description="measurements kept; the oldest go")
    off: tuple[str, ...] = Field(default=(), description="watches not wanted, by name or group")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.baseline < 5 * self.batch:
            raise ValueError(f"a baseline of {self.baseline} is too short for batches of {self.batch}: five at least")
        return self


class MetricsSection(Section):
    """Prometheus metrics, on loopback only."""

    port: int = Field(default=0, ge=0, le=65535, description="of http://127.0.0.1:PORT/metrics; 0: not served")
