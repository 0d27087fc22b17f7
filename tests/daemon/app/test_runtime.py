"""The composition root: what is not needed to move safely keeps no station from starting."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import AsyncExitStack
from pathlib import Path

import pytest
from structlog.testing import capture_logs

from daemon.app.runtime import put_together
from daemon.config.model import Config, load_config
from daemon.tools.demo.settings import Places, write_settings

BOARD = """{"name": "b", "side": "top", "width_um": 1000.0, "height_um": 1000.0, "points": []}"""


@pytest.fixture
def port() -> Iterator[socket.socket]:
    """A port of this computer, which somebody else holds."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        yield taken


def _config(folder: Path, port: int) -> Config:
    (folder / "board.json").write_text(BOARD)
    file = write_settings(Places(folder, folder))
    file.write_text(f"{file.read_text()}\n[metrics]\nport = {port}\n")
    return load_config(file)


async def test_a_metrics_port_in_use_is_told_and_the_daemon_starts_without(tmp_path: Path, port: socket.socket) -> None:
    number = port.getsockname()[1]
    async with AsyncExitStack() as stack:
        with capture_logs() as said:
            runtime = await put_together(_config(tmp_path, number), None, stack)
        assert runtime.metrics.address is None
        assert [(entry["event"], entry["port"]) for entry in said if entry["log_level"] == "error"] == [
            ("metrics_not_served", number)
        ]


async def test_a_free_port_serves_metrics(tmp_path: Path, port: socket.socket) -> None:
    number = port.getsockname()[1]
    port.close()
    async with AsyncExitStack() as stack:
        runtime = await put_together(_config(tmp_path, number), None, stack)
        assert runtime.metrics.address == ("127.0.0.1", number)
