"""An emulated machine for a session of tests. Only `make test-vm` collects them: they take minutes."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

from tests.vm.station import Station, station
from tests.vm.vm import why_not

WANTED = os.environ.get("REPROBE_TEST_VM") == "build"
collect_ignore_glob = [] if WANTED else ["test_*.py"]
NOT_SHOWN = (
    "frame rate and exposure: pictures are fed a few times a second, and neither video device has an exposure control",
    "parity, baud rate and noise: an emulated UART carries whole bytes, whatever it is set to",
    "the direction of RS-485 and the silence between frames: there is no transceiver, and emulated time is too coarse",
    "USB: the devices come and go by their drivers, not by a plug",
    "how long anything takes: the processor is emulated",
)


@pytest.fixture(scope="session")
def stand(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Station]:
    """A station in an emulated machine, laid out and wired; the daemon is not started yet."""
    obstacle = why_not()
    assert obstacle is None, obstacle
    with station(tmp_path_factory.mktemp("vm")) as up:
        yield up


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say what these tests say nothing about."""
    if not WANTED:
        return
    terminalreporter.write_sep("-", "what an emulated machine cannot show")
    for line in NOT_SHOWN:
        terminalreporter.write_line(f"- {line}")
