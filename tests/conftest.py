"""What holds for every test: properties are seeded and have no timed deadline."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator

import pytest
import structlog
from hypothesis import HealthCheck, Phase, settings

# As the daemon's command line does: threads within one small product cost more than they bring, most of all where other
# tests run beside. It is read when numpy is first imported, and inherited by the processes that tests start.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# These machines are noisy: how long an example takes says nothing.
settings.register_profile("reprobe", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile(
    "first-failure", settings.get_profile("reprobe"), phases=[phase for phase in Phase if phase is not Phase.shrink]
)
settings.load_profile("reprobe")


@pytest.fixture
def logging_as_before() -> Iterator[None]:
    """Undo what a command that sets logging up for its process did to this one."""
    root = logging.getLogger()
    before = root.handlers[:], root.level
    yield
    structlog.reset_defaults()
    root.handlers[:], root.level = before[0], before[1]
