"""A whole station for a module of tests: simulated station and daemon as processes, homed, taught and calibrated."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from daemon.client import Client
from tests.station.rig import Rig, running_rig

LONG_S = 600.0


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave whole stations more time: on a computer that has much else to do they are slow, not wrong."""
    for item in items:
        if item.path.is_relative_to(Path(__file__).parent) and item.get_closest_marker("timeout") is None:
            item.add_marker(pytest.mark.timeout(LONG_S))


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
