"""The configuration: one TOML file, one typed tree, every error at once with its path.

Nothing is repaired or dropped: a bad file is refused whole. Limits and addresses have no defaults, for a guessed limit
moves a needle into something.
"""

from __future__ import annotations

import stat
from pathlib import Path

from pydantic import Field

from daemon.config.paths import resolved
from daemon.config.problems import ConfigError, Unlikely
from daemon.config.reading import read_checked, read_unlikely
from daemon.config.sections.base import Section
from daemon.config.sections.devices import AxesSection, BusSection, CameraSection, LightsSection
from daemon.config.sections.meter import MeterSection
from daemon.config.sections.motion import (
    BoardSection,
    ClearanceSection,
    ControlPointSection,
    GantrySection,
    HeadSection,
    ServoSection,
)
from daemon.config.sections.service import ApiSection, MaintenanceSection, MetricsSection, StationSection
from daemon.config.sections.touching import (
    BrushSection,
    LadderSection,
    PinSection,
    ReferenceSection,
    SenseSection,
    TouchSection,
)

__all__ = ["Config", "ConfigError", "load_config", "unlikely"]


class Config(Section):
    """The whole configuration."""

    station: StationSection
    bus: dict[str, BusSection] = Field(min_length=1)
    axes: AxesSection
    gantry: GantrySection
    clearance: ClearanceSection | None = None
    lights: LightsSection
    camera: CameraSection
    head: HeadSection
    board: BoardSection
    control_point: ControlPointSection | None = None
    meter: MeterSection | None = None
    touch: TouchSection = TouchSection()
    sense: SenseSection = SenseSection()
    ladder: LadderSection = LadderSection()
    reference: ReferenceSection | None = None
    brush: BrushSection | None = None
    pin: PinSection = PinSection()
    servo: ServoSection = ServoSection()
    api: ApiSection = ApiSection()
    metrics: MetricsSection = MetricsSection()
    maintenance: MaintenanceSection = MaintenanceSection()

    @property
    def lowest_z_um(self) -> float:
        """The lowest that Z is ever sent: the axis' own minimum, or the floor where that is higher."""
        return max(self.axes.z.minimum, self.gantry.floor_z_um)

    @property
    def press_um(self) -> float:
        """How far a touch for a measurement pushes the pin in, where its request says nothing."""
        return self.touch.overtravel_um if self.touch.overtravel_um is not None else self.gantry.overtravel_um


def load_config(path: Path) -> Config:
    """Read and check a configuration; raise `ConfigError` naming every problem."""
    config = read_checked(path, Config)
    _require_own(path, strict=config.api.curve)
    return resolved(config, path.resolve().parent)


def unlikely(path: Path) -> Unlikely:
    """Return what a configuration has that is possible and hardly meant."""
    return read_unlikely(path, Config)


def _require_own(path: Path, *, strict: bool) -> None:
    """Refuse a file that anybody could change; `strict`: also one that its group could."""
    mode = path.stat().st_mode
    if mode & (stat.S_IWOTH | (stat.S_IWGRP if strict else 0)):
        problem = f"can be changed by others (mode {stat.S_IMODE(mode):04o}); chmod go-w it"
        raise ConfigError(path, [("(file)", problem)])
