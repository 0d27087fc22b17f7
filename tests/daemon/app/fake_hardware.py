"""Devices that answer at once, each answer an await at which something else may happen."""

from __future__ import annotations

import contextlib
from collections.abc import Awaitable, Callable, Iterable
from types import SimpleNamespace
from typing import Any

import numpy as np

from drivers.errors import DeviceError

AXES = ("x", "y", "z", "theta")
Gate = Callable[[str], Awaitable[None]]


async def _open(_what: str) -> None:
    return


class FakeHardware:
    """Four drives, lights and a camera; `errors` maps what is asked to what it raises."""

    def __init__(self, gate: Gate = _open) -> None:
        self.gate = gate
        self.errors: dict[str, Exception] = {}
        self.homed = dict.fromkeys(AXES, True)
        self.lifted_to_um: list[float] = []
        self.drive_error = False
        self.did: list[str] = []
        self.gantry = self
        self.lights = self
        self.buses: dict[str, Any] = {}
        self.axes: tuple[Any, ...] = ()
        self.found_fit = True
        self.delivered = 0
        self.lit_level = 5
        """How bright a picture is that is taken while the lamps are off."""
        self.settle_s = 0.0
        self.camera = SimpleNamespace(
            settings=dict, frame_after=self._frame, open=self._open_camera, close=self._close_camera,
            statistics=lambda: SimpleNamespace(delivered=self.delivered),
        )  # fmt: skip
        self.moving = False
        self.missing_answers = 0
        self.check_line_s = 0.0
        self.z_um = 12_000.0

    @property
    def found_homed(self) -> bool:
        """What the drives told as they were opened."""
        return all(self.homed.values())

    @property
    def found_position(self) -> Any:
        """Where they told to be as they were opened."""
        return SimpleNamespace(x_um=0.0, y_um=0.0, z_um=self.z_um, theta_deg=0.0)

    @property
    def standing(self) -> Any:
        """Where they told to be when they were last asked how they are."""
        return self.found_position

    async def _ask(self, what: str) -> None:
        await self.gate(what)
        self.did.append(what)
        if what in self.errors:
            raise self.errors[what]

    async def in_trouble(self, _deadline: Any) -> bool:
        await self._ask("in_trouble")
        return self.drive_error

    async def recover(self, _deadline: Any) -> None:
        await self._ask("recover")
        self.drive_error = False

    async def check_health(self, _deadline: Any) -> None:
        await self._ask("check_health")

    async def forget_homing(self, _deadline: Any, axes: Iterable[str] = AXES) -> None:
        for axis in axes:
            await self._ask(f"forget {axis}")
            self.homed[axis] = False

    async def is_homed(self) -> bool:
        await self._ask("homed")
        return all(self.homed.values())

    async def _frame(self, _since_s: float, _deadline: Any) -> Any:
        await self._ask("frame")
        self.delivered += 1
        return SimpleNamespace(pixels=np.full((8, 8, 3), self.lit_level, np.uint8))

    async def _open_camera(self, _deadline: Any) -> None:
        await self._ask("open camera")

    async def _close_camera(self) -> None:
        await self._ask("close camera")

    async def stop_again(self) -> None:
        """Try to stop what may run; it works once no error is set for it."""
        with contextlib.suppress(DeviceError):
            await self._ask("stop again")
            self.gantry.unstopped = ()  # type: ignore[attr-defined]

    async def quick_stop(self) -> None:
        await self._ask("quick_stop")

    async def position(self, _deadline: Any) -> Any:
        await self._ask("position")
        return SimpleNamespace(x_um=0.0, y_um=0.0, z_um=self.z_um, theta_deg=0.0)

    async def move_to(self, target: Any, _deadline: Any, **_how: Any) -> Any:
        await self._ask("move")
        self.z_um = target.z_um
        self.lifted_to_um.append(target.z_um)
        return target

    async def set(self, _light: Any, _deadline: Any) -> float:
        await self._ask("light")
        return 0.0

    async def close(self, _deadline: Any) -> None:
        await self._ask("close")


class FakeGantry:
    """The gantry's side of the devices, whose `homed` is a question and not a table."""

    def __init__(self, hardware: FakeHardware) -> None:
        self._hardware = hardware
        self.moving = False
        self.at_rest_s = 0.0
        self.unstopped: tuple[str, ...] = ()
        self.forget_homing = hardware.forget_homing
        self.quick_stop = hardware.quick_stop
        self.position = hardware.position
        self.move_to = hardware.move_to

    async def homed(self, _deadline: Any) -> bool:
        return await self._hardware.is_homed()

    async def stop_again(self) -> None:
        await self._hardware.stop_again()


def hardware(gate: Gate = _open) -> FakeHardware:
    """Return devices that are well and homed."""
    made = FakeHardware(gate)
    made.gantry = FakeGantry(made)  # type: ignore[assignment]
    return made
