"""A supervised station for each test."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.daemon.app.supervised_station import Station


@pytest.fixture
def station(tmp_path: Path) -> Station:
    return Station(tmp_path)
