"""The composition root: what is not needed to move safely keeps no station from starting."""

from __future__ import annotations

import asyncio
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


def _at_taken_address(folder: Path, taken: socket.socket, key: str) -> tuple[Config, str]:
    """Return a configuration in which this key of `[api]` names an address that is in use, and that address."""
    config, endpoint = _config(folder, 0), f"tcp://127.0.0.1:{taken.getsockname()[1]}"
    return config.model_copy(update={"api": config.api.model_copy(update={key: endpoint})}), endpoint


async def test_an_address_of_live_pictures_in_use_is_told_and_the_daemon_starts_without(
    tmp_path: Path, port: socket.socket
) -> None:
    config, _ = _at_taken_address(tmp_path, port, "live")
    async with AsyncExitStack() as stack:
        with capture_logs() as said:
            runtime = await put_together(config, None, stack)
        assert runtime.live is not None
        assert not runtime.live.is_served
        assert [entry["event"] for entry in said if entry["log_level"] == "error"] == ["live_not_served"]


async def test_an_address_of_events_in_use_is_told_and_the_daemon_starts_without(
    tmp_path: Path, port: socket.socket
) -> None:
    config, endpoint = _at_taken_address(tmp_path, port, "events")
    async with AsyncExitStack() as stack:
        with capture_logs() as said:
            runtime = await put_together(config, None, stack)
        assert [entry["event"] for entry in said if entry["log_level"] == "error"] == ["events_not_served"]
        runtime.unserved.look()
        assert endpoint in runtime.status_line.line()
        await runtime.monitor.load()
        judging = asyncio.create_task(runtime.monitor.run())
        await runtime.monitor.settled()
        judging.cancel()
        assert runtime.monitor.alerts.standing["not_served"].evidence


async def test_a_free_port_serves_metrics(tmp_path: Path, port: socket.socket) -> None:
    number = port.getsockname()[1]
    port.close()
    async with AsyncExitStack() as stack:
        runtime = await put_together(_config(tmp_path, number), None, stack)
        assert runtime.metrics.address == ("127.0.0.1", number)


async def test_a_metrics_port_that_becomes_free_is_served_and_that_is_said(tmp_path: Path, port: socket.socket) -> None:
    number = port.getsockname()[1]
    async with AsyncExitStack() as stack:
        with capture_logs() as said:
            runtime = await put_together(_config(tmp_path, number), None, stack)
            trying = asyncio.create_task(runtime.metrics_port.run(every_s=0.01))
            await asyncio.sleep(0.05)
            port.close()
            async with asyncio.timeout(30.0):
                while runtime.metrics.address is None:  # noqa: ASYNC110  # what is waited for has no event of its own
                    await asyncio.sleep(0.01)
            await asyncio.sleep(0.05)
            assert not trying.done(), "a part that ended would end the daemon"
            trying.cancel()
        assert runtime.metrics.address == ("127.0.0.1", number)
        told = [entry["event"] for entry in said if entry["event"].startswith("metrics")]
        assert told == ["metrics_not_served", "metrics_served"], "each once"


async def test_what_a_kill_left_half_written_among_the_calibrations_is_gone_after_a_start(tmp_path: Path) -> None:
    config = _config(tmp_path, 0)
    folder = config.station.data_dir / "calibration"
    (folder / "history").mkdir(parents=True)
    half = [folder / ".new-abc123.json", folder / "history" / ".new-x.npz"]
    kept = [folder / "of-somebody.json", folder / ".new-folder"]
    for path in (*half, kept[0]):
        path.write_text("{}")
    kept[1].mkdir()
    async with AsyncExitStack() as stack:
        await put_together(config, None, stack)
    assert not any(path.exists() for path in half)
    assert all(path.exists() for path in kept)
