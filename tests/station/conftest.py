"""A whole station for a module of tests: simulated station and daemon as processes, homed, taught and calibrated."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from daemon.client import Client
from tests.station.rig import Rig, running_rig


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    """A station that has been set up; tests leave it idle."""
    with running_rig(tmp_path_factory.mktemp("rig")) as running:
        with running.client() as client:
            running.session(client).set_up()
        yield running


@pytest.fixture
def client(rig: Rig) -> Iterator[Client]:
    """A tester's connection to it."""
    with rig.client() as connected:
        yield connected
