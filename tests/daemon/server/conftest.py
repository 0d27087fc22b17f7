"""Handlers of an idle station, and its parts."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from daemon.config.current import CurrentSettings
from daemon.server.handlers import Collaborators, Handlers
from daemon.storage.journal import Journal
from tests.daemon.server.fake_daemon import (
    Daemon,
)


@pytest.fixture
async def station(journal: Journal, tmp_path: Path) -> Daemon:
    daemon = Daemon()
    kept = daemon.config.station.model_copy(update={"data_dir": tmp_path})
    daemon.config = daemon.config.model_copy(update={"station": kept})
    return daemon


@pytest.fixture
def settings(station: Daemon) -> CurrentSettings:
    return CurrentSettings(station.config, station.board)


@pytest.fixture
async def handlers(station: Daemon, journal: Journal, settings: CurrentSettings) -> Handlers:
    parts: Any = {
        "runner": station.jobs, "reset": station.reset, "light": station.light,
        "calibrations": SimpleNamespace(in_force=station.calibrations),
        "images": station.pictures, "metrics": station.metrics, "monitor": station.monitor, "vitals": station.vitals,
        "needle": station.needle,
    }  # fmt: skip
    return Handlers(Collaborators(settings=settings, latch=station.latch, journal=journal, **parts))
