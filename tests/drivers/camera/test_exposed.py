"""A picture is told of as soon as it is exposed, and is that picture and no other when it arrives."""

import asyncio
import time
from collections.abc import Callable

import pytest

from drivers.camera import V4L2Camera, running
from drivers.camera.running import RunningCamera
from drivers.deadline import Deadline
from drivers.errors import CameraError, CameraTimeout, FrameLost
from tests.drivers.camera.fakes import World, config, until


async def test_an_exposure_is_told_while_its_picture_is_still_on_its_way(
    world: World, v4l2: V4L2Camera, soon: Deadline
) -> None:
    world.fetched.clear()
    t_s = time.monotonic()
    exposed = await v4l2.exposed_after(t_s, soon)
    assert t_s <= exposed.over_s <= time.monotonic()
    waiting = asyncio.create_task(exposed.frame(soon))
    await until(lambda: world.retrieves > 0, soon)
    assert not waiting.done()
    world.fetched.set()
    frame = await waiting
    assert frame.exposure_start_s >= t_s
    assert frame.received_s >= exposed.over_s


async def test_of_any_camera_the_picture_is_the_one_that_was_exposed(camera: RunningCamera, soon: Deadline) -> None:
    """It should be exposed before the instant at which that was told, though later pictures have come meanwhile."""
    for _ in range(3):
        t_s = time.monotonic()
        exposed = await camera.exposed_after(t_s, soon)
        later = await camera.frame_after(time.monotonic(), soon)
        frame = await exposed.frame(soon)
        assert t_s <= frame.exposure_start_s <= exposed.over_s
        assert frame.sequence < later.sequence


def tear(world: World) -> None:
    world.torn = True


def freeze(world: World) -> None:
    world.frozen = True


def gone(world: World) -> None:
    world.breaks["retrieve"] = RuntimeError("gone")


@pytest.mark.parametrize("spoil", [tear, freeze, gone])
async def test_a_picture_that_does_not_arrive_whole_is_lost_and_no_later_one_stands_for_it(
    world: World, v4l2: V4L2Camera, soon: Deadline, spoil: Callable[[World], None]
) -> None:
    """It should be a camera error, and who waits for any picture gets one once it is well again."""
    await v4l2.frame_after(time.monotonic(), soon)
    world.fetched.clear()
    exposed = await v4l2.exposed_after(time.monotonic(), soon)
    any_frame = asyncio.create_task(v4l2.frame_after(time.monotonic(), soon))
    await until(lambda: v4l2.waiting == 1, soon)
    spoil(world)
    world.fetched.set()
    if spoil is freeze:  # from the next picture on it is the same
        await exposed.frame(soon)
        exposed = await v4l2.exposed_after(time.monotonic(), soon)
    with pytest.raises(FrameLost) as lost:
        await exposed.frame(soon)
    assert isinstance(lost.value, CameraError)
    world.torn = world.frozen = False
    world.breaks.clear()
    assert (await any_frame).sequence > 0


async def test_no_exposure_in_time_is_a_camera_time_out(camera: RunningCamera) -> None:
    with pytest.raises(CameraTimeout, match="no picture exposed after"):
        await camera.exposed_after(time.monotonic() + 100.0, Deadline.after(0.03))
    assert camera.waiting == 0


async def test_a_picture_that_does_not_arrive_in_time_is_a_camera_time_out(
    world: World, v4l2: V4L2Camera, soon: Deadline
) -> None:
    world.fetched.clear()
    exposed = await v4l2.exposed_after(time.monotonic(), soon)
    with pytest.raises(CameraTimeout, match="did not arrive in time"):
        await exposed.frame(Deadline.after(0.01))
    world.fetched.set()
    await v4l2.frame_after(time.monotonic(), soon)


async def test_who_gives_up_leaves_nothing_behind(world: World, v4l2: V4L2Camera, soon: Deadline) -> None:
    """It should forget the wish, before its exposure and after."""
    early = asyncio.create_task(v4l2.exposed_after(time.monotonic() + 100.0, soon))
    await until(lambda: v4l2.waiting == 1, soon)
    early.cancel()
    with pytest.raises(asyncio.CancelledError):
        await early
    assert v4l2.waiting == 0
    world.fetched.clear()
    exposed = await v4l2.exposed_after(time.monotonic(), soon)
    late = asyncio.create_task(exposed.frame(soon))
    await asyncio.sleep(0)
    late.cancel()
    with pytest.raises(asyncio.CancelledError):
        await late
    world.fetched.set()
    await v4l2.frame_after(time.monotonic(), soon)


async def test_a_camera_that_hangs_with_a_picture_refuses_it_and_spoils_none_of_the_next_opening(
    world: World, soon: Deadline, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(running, "CLOSE_WITHIN_S", 0.05)
    camera = V4L2Camera(config(refuse_identical=False), world.factory)  # each opening counts its pictures anew
    await camera.open(soon)
    world.fetched.clear()
    exposed = await camera.exposed_after(time.monotonic(), soon)
    await until(lambda: world.retrieves == 1, soon)
    await camera.close()
    with pytest.raises(CameraError, match="was closed"):
        await exposed.frame(soon)
    await camera.open(soon)
    t_s = time.monotonic()
    again = await camera.exposed_after(t_s, soon)
    world.fetched.set()
    assert (await again.frame(soon)).exposure_start_s >= t_s
    await camera.close()
