"""Cameras of both kinds with a far end that a test may spoil."""

from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import pytest

from drivers.camera import StreamCamera, V4L2Camera
from drivers.camera.running import RunningCamera
from drivers.deadline import Deadline
from tests.drivers.camera.fakes import StreamServer, World, config


@pytest.fixture
def world() -> World:
    return World()


@pytest.fixture
async def v4l2(world: World, soon: Deadline) -> AsyncIterator[V4L2Camera]:
    camera = V4L2Camera(config(), world.factory)
    await camera.open(soon)
    yield camera
    await camera.close()


@pytest.fixture
def server(tmp_path: Path) -> Iterator[StreamServer]:
    server = StreamServer(f"ipc://{tmp_path}/camera")
    yield server
    server.close()


@pytest.fixture
async def stream(server: StreamServer, soon: Deadline) -> AsyncIterator[StreamCamera]:
    camera = StreamCamera(config(server.endpoint, exposure_us=20000))
    await camera.open(soon)
    yield camera
    await camera.close()


@pytest.fixture(params=["v4l2", "stream"])
def camera(request: pytest.FixtureRequest) -> RunningCamera:
    return request.getfixturevalue(request.param)
