"""A station on fake devices."""

import pytest

from tests.daemon.station.bench import Bench


@pytest.fixture
def bench() -> Bench:
    return Bench()
