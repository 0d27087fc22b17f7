"""Frames of a scene at rest under one light: taken, or exposed first and fetched while the light changes already."""

from __future__ import annotations

import time

from daemon.station.allowance import Clocked
from daemon.station.devices import Hardware
from drivers.camera import Exposed, Frame
from drivers.deadline import Deadline
from drivers.lights import Light


class Frames:
    """Takes frames that were exposed wholly after light and head had settled."""

    def __init__(self, hardware: Hardware, patience_s: float) -> None:
        """Take the devices, and how long a frame may take once light and head are steady."""
        self._hardware, self._patience_s = hardware, patience_s

    async def take(self, light: Light, still_at_s: float, caller: Clocked) -> Frame:
        """Take one frame; the head is steady from `still_at_s` on (monotonic). One that is torn is taken again."""
        ready_s, by = await self._settled(light, still_at_s, caller)
        asked_s = time.monotonic()
        frame = await self._hardware.camera.frame_after(ready_s, by)
        # Waiting for the exposure and for the camera to send it; decoding comes after that and is software.
        _book(caller, ready_s, asked_s, frame.received_s)
        return frame

    async def expose(self, light: Light, still_at_s: float, caller: Clocked) -> Exposed:
        """Have one frame exposed as `take` does; from then on the light may change, `arrived` gives that frame."""
        ready_s, by = await self._settled(light, still_at_s, caller)
        asked_s = time.monotonic()
        exposed = await self._hardware.camera.exposed_after(ready_s, by)
        _book(caller, ready_s, asked_s, exposed.over_s)
        return exposed

    async def arrived(self, exposed: Exposed, caller: Clocked) -> Frame:
        """Return a frame that was exposed; raise FrameLost where it did not arrive whole."""
        return await exposed.frame(self._by(0.0, caller))

    async def _settled(self, light: Light, still_at_s: float, caller: Clocked) -> tuple[float, Deadline]:
        """Switch to a light; return from when on light and head are steady, and by when a frame is to be there."""
        lights = self._hardware.lights
        with caller.watch.spend("bus"):
            lit_at_s = await lights.set(light, caller.deadline) + lights.settle_s
        ready_s = max(lit_at_s, still_at_s)
        return ready_s, self._by(ready_s - time.monotonic(), caller)

    def _by(self, wait_s: float, caller: Clocked) -> Deadline:
        """Return by when a frame has to be there that is waited for so long."""
        return caller.deadline.within(max(0.0, wait_s) + self._patience_s)


def _book(caller: Clocked, ready_s: float, asked_s: float, over_s: float) -> None:
    """Book what was waited for a frame: first for steady light, then for its exposure."""
    caller.watch.book("light", ready_s - asked_s)
    caller.watch.book("exposure", over_s - max(ready_s, asked_s))
