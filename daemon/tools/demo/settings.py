"""Settings of a daemon that drives the simulated station: the same file a real station has."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from daemon.config.bench_template import REPLY_MS, BenchPlaces, BenchWaits, bench_toml

__all__ = ["REPLY_MS", "Places", "write_settings"]


@dataclass(frozen=True)
class Places:
    """Where everything of one demonstration is: files in `out`, sockets in a short folder of their own."""

    out: Path
    sockets: Path

    @property
    def line(self) -> str:
        """The serial line."""
        return str(self.sockets / "bus")

    def socket(self, name: str) -> str:
        """Return the ZeroMQ endpoint of that name."""
        return f"ipc://{self.sockets / name}"


def write_settings(
    places: Places,
    *,
    speed: float = 1.0,
    reply_ms: float = REPLY_MS,
    pictures: Literal["failed", "all", "none"] = "all",
) -> Path:
    """Write station.toml and return its path. `speed`: how many times as fast the station's time runs as the clock."""
    bench = BenchPlaces(
        by="reprobe demo",
        name="demo",
        data_dir="station",
        line=places.line,
        camera=places.socket("camera"),
        control=places.socket("control"),
        events=places.socket("events"),
        live=places.socket("live"),
    )
    path = places.out / "station.toml"
    path.write_text(bench_toml(bench, BenchWaits(speed, reply_ms), pictures))
    return path
