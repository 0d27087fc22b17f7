"""Open the devices that the configuration names, and look after them as one."""

from __future__ import annotations

from contextlib import AsyncExitStack

import structlog

from daemon.config import AxisSection, BusSection, CameraSection, Config, LightsSection
from drivers.bus import Line, ModbusBus, OdAddressing, SerialLine, TcpLine
from drivers.camera import Camera, CameraConfig, StreamCamera, V4L2Camera
from drivers.deadline import Deadline
from drivers.errors import DeviceError, DriveFault, LimitHit
from drivers.gantry import Gantry, GantryConfig
from drivers.l4118 import Axis, AxisConfig, HomingConfig
from drivers.lights import Light, Lights, ModbusRelayLights, SerialRelayLights

THETA_WINDOW_DEG = 0.03
HOMING_ZERO_SHARE = 0.2
"""Share of the homing speed with which the switch's edge is sought."""
log = structlog.get_logger(__name__)


class Hardware:
    """The open devices. Made by `open_hardware`; `close` leaves the station dark and still."""

    def __init__(self, gantry: Gantry, lights: Lights, camera: Camera, stack: AsyncExitStack) -> None:
        self.gantry = gantry
        self.lights = lights
        self.camera = camera
        self._stack = stack

    async def recover(self, deadline: Deadline, *, reference_lost: bool) -> None:
        """Clear what the drives hold and darken; raise what is still wrong. Moves nothing.

        A drive in fault had no power on its motor: its axis may stand elsewhere, so all have to be homed again.
        """
        if reference_lost or any(axis.error_code for axis in await self.gantry.health(deadline)):
            await self.gantry.forget_homing(deadline)
        await self.gantry.reset(deadline)
        await self.gantry.start(deadline)
        await self.lights.set(Light.OFF, deadline)

    async def check_health(self, deadline: Deadline) -> None:
        """Raise if a drive is in fault or stands on a limit switch."""
        for axis in await self.gantry.health(deadline):
            if axis.error_code or axis.state.lower().startswith("fault"):
                raise DriveFault(
                    f"{axis.error_meaning} ({axis.error_code:04X}h)", device=axis.name, code=axis.error_code
                )
            if axis.homed and (axis.negative_limit or axis.positive_limit):
                raise LimitHit("stands on a limit switch", device=axis.name)

    async def close(self, deadline: Deadline) -> None:
        """Stop motion, go dark, let go of everything; what fails is logged, the rest goes on."""
        try:
            if self.gantry.moving:
                await self.gantry.quick_stop()
        except DeviceError as exc:
            log.error("not_stopped", error=str(exc))
        try:
            await self._stack.aclose()
        except DeviceError as exc:
            log.error("not_closed", error=str(exc), remaining_s=deadline.remaining_s)


async def open_hardware(config: Config, deadline: Deadline) -> Hardware:
    """Open buses, drives, lights and camera; if one fails, close the others again and raise its error."""
    async with AsyncExitStack() as stack:
        buses: dict[str, ModbusBus] = {}
        for name, section in config.bus.items():
            gap_s, timeout_s = section.gap_ms / 1e3, section.timeout_ms / 1e3
            buses[name] = await ModbusBus.open(_line(section), gap_s=gap_s, timeout_s=timeout_s)
            stack.push_async_callback(buses[name].close)
        lights = await _lights(config.lights, buses, deadline)
        stack.push_async_callback(lights.close)
        gantry = _gantry(config, buses)
        await gantry.start(deadline)
        camera = _camera(config.camera)
        await camera.open(deadline)
        stack.push_async_callback(camera.close)
        return Hardware(gantry, lights, camera, stack.pop_all())


def _line(section: BusSection) -> Line:
    if section.host is not None:
        return TcpLine(section.host, section.tcp_port, section.framing)
    return SerialLine(str(section.port), section.baudrate, section.parity, section.stopbits)


def _gantry(config: Config, buses: dict[str, ModbusBus]) -> Gantry:
    sections = {name: getattr(config.axes, name) for name in ("x", "y", "z", "theta")}
    axes = {name: Axis(buses[section.bus], _axis(name, section)) for name, section in sections.items()}
    limits = GantryConfig(
        safe_z_um=config.gantry.safe_z_um,
        backlash_um=config.gantry.approach_um,
        backlash_theta_deg=config.gantry.approach_deg,
    )
    return Gantry(axes, limits)


def _axis(name: str, section: AxisSection) -> AxisConfig:
    homing = HomingConfig(
        method=section.homing_method,
        switch_speed_units_s=section.homing_speed,
        zero_speed_units_s=section.homing_speed * HOMING_ZERO_SHARE,
        acceleration_units_s2=section.acceleration,
        home_position_units=section.homing_position,
    )
    access = section.object_access
    return AxisConfig(
        name=name,
        address=section.address,
        increments_per_unit=section.increments_per_unit,
        min_units=section.minimum,
        max_units=section.maximum,
        speed_units_s=section.speed,
        acceleration_units_s2=section.acceleration,
        homing=homing,
        window_units=THETA_WINDOW_DEG if name == "theta" else 1.0,
        addressing=OdAddressing(**access.model_dump()) if access is not None else None,
        word_order=section.word_order,
    )


async def _lights(section: LightsSection, buses: dict[str, ModbusBus], deadline: Deadline) -> Lights:
    settle_s = section.settle_ms / 1e3
    if section.kind == "modbus":
        bus = buses[str(section.bus)]
        return await ModbusRelayLights.open(
            bus, section.address, section.white, section.red, settle_s=settle_s, deadline=deadline
        )
    return await SerialRelayLights.open(
        str(section.port), section.white, section.red, settle_s=settle_s, deadline=deadline
    )


def _camera(section: CameraSection) -> Camera:
    config = CameraConfig(
        device=section.device or section.endpoint or "",
        width_px=section.width,
        height_px=section.height,
        encoding=section.encoding,
        exposure_us=section.exposure_us,
        gain=section.gain,
        focus=section.focus,
        white_balance_k=section.white_balance_k,
    )
    return StreamCamera(config) if section.kind == "stream" else V4L2Camera(config)
