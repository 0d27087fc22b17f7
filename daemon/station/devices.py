"""Devices of a station: opened by the configuration, closed as one."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AsyncExitStack

import structlog

from daemon.config.model import Config
from daemon.config.sections.devices import AxisSection, BusSection, CameraSection, LightsSection
from daemon.config.sections.meter import MeterMethodSection, MeterSection
from daemon.platform.beside import beside
from drivers.bus import Line, ModbusBus, OdAddressing, SerialLine, TcpLine
from drivers.camera import Camera, CameraConfig, StreamCamera, V4L2Camera
from drivers.deadline import Deadline
from drivers.errors import DeviceError, EmergencyStop, LimitHit, MotionError
from drivers.gantry import AXES, AxisCondition, Gantry, GantryConfig, Position, SelfTest
from drivers.l4118 import HEALTH_REQUESTS, Axis, AxisConfig, HomingConfig
from drivers.lights import Light, Lights, ModbusRelayLights, SerialRelayLights
from drivers.meter import Meter, MeterSettings, Method, MethodSettings, ScpiMeter, parse_address

THETA_WINDOW_DEG = 0.03
HOMING_ZERO_SHARE = 0.2
"""Share of the homing speed with which the switch's edge is sought."""
log = structlog.get_logger(__name__)


class Hardware:
    """The open devices. Made by `open_hardware`; `close` leaves the station dark and still."""

    def __init__(
        self,
        gantry: Gantry,
        lights: Lights,
        camera: Camera,
        buses: Mapping[str, ModbusBus],
        stack: AsyncExitStack,
        found: Mapping[str, SelfTest],
        check_line_s: float = 0.0,
        meter: Meter | None = None,
    ) -> None:
        self.gantry = gantry
        self.meter = meter
        """The measuring instrument; it is connected when it is first asked, for most work needs none."""
        self.check_line_s = check_line_s
        """How long the requests of one check of all drives are on their lines."""
        self.found = found
        """What the drives' self-test settled when they were opened."""
        self.buses = buses
        self.lights = lights
        self.camera = camera
        self.axes: tuple[AxisCondition, ...] = ()
        """What the drives said of themselves when they were last asked."""
        self._stack = stack

    @property
    def found_fit(self) -> bool:
        """Whether the self-test found that nothing speaks against work, but perhaps that a reference is missing."""
        return all(axis.fit for axis in self.found.values())

    @property
    def found_homed(self) -> bool:
        """Whether the self-test found that every drive has its reference."""
        return all(axis.homed for axis in self.found.values())

    @property
    def found_position(self) -> Position:
        """Where the self-test found the machine."""
        x_um, y_um, z_um, theta_deg = (self.found[name].position_units for name in AXES)
        return Position(x_um, y_um, z_um, theta_deg)

    @property
    def standing(self) -> Position | None:
        """Where the machine was when the drives were last asked how they are; None before that."""
        at = {axis.name: axis.position_units for axis in self.axes}
        return Position(at["x"], at["y"], at["z"], at["theta"]) if at else None

    @property
    def missing_answers(self) -> int:
        """Count what was asked on all lines and had no answer, or none that made sense."""
        return sum(bus.missing_answers for bus in self.buses.values())

    async def in_trouble(self, deadline: Deadline) -> bool:
        """Tell whether a drive is in trouble: it had no power on its motor, so that its axis may stand elsewhere."""
        return any(axis.trouble() for axis in await self.gantry.health(deadline))

    async def recover(self, deadline: Deadline) -> None:
        """Clear what the drives hold and darken; raise what is still wrong. Moves nothing."""
        await self.gantry.reset(deadline)
        await self.gantry.start(deadline)
        await self.lights.set(Light.OFF, deadline)

    async def check_health(self, deadline: Deadline) -> None:
        """Raise if a drive is in fault, was switched off from outside, lost its power, or stands on a limit switch.

        Of several troubles an emergency stop is raised first: the others may be its consequences. The lamps' relay
        is asked last, whether it still shows what it was told.
        """
        self.axes = await self.gantry.health(deadline)
        troubles = [trouble for axis in self.axes if (trouble := _trouble(axis))]
        for trouble in sorted(troubles, key=lambda one: not isinstance(one, EmergencyStop)):
            raise trouble
        await self.lights.check(deadline)

    async def close(self, deadline: Deadline) -> None:
        """Stop motion, go dark, let go of everything; what fails is logged, the rest goes on."""
        try:
            if self.gantry.moving or self.gantry.unstopped:
                await self.gantry.quick_stop()
        except DeviceError as exc:
            log.error("not_stopped", error=str(exc))
        try:
            await self._stack.aclose()
        except DeviceError as exc:
            log.error("not_closed", error=str(exc), remaining_s=deadline.remaining_s)


def _trouble(axis: AxisCondition) -> MotionError | None:
    on_limit = axis.homed and (axis.negative_limit or axis.positive_limit)
    return axis.trouble() or (LimitHit("stands on a limit switch", device=axis.name) if on_limit else None)


async def open_hardware(config: Config, deadline: Deadline) -> Hardware:
    """Open buses, drives, lights and camera; if one fails, close the others again and raise its error."""
    async with AsyncExitStack() as stack:
        buses = await open_buses(config, stack)
        camera = make_camera(config.camera)
        stack.push_async_callback(camera.close)
        # Closed before the camera, which may take its time: first the station is dark.
        lights = await open_lights(config.lights, buses, deadline)
        stack.push_async_callback(lights.close)
        gantry = _gantry(config, buses)
        meter = make_meter(config.meter)
        if meter is not None:
            stack.push_async_callback(meter.close)
        found = await beside(camera.open(deadline), gantry.start(deadline))
        return Hardware(gantry, lights, camera, buses, stack.pop_all(), found, check_line_s(config, buses), meter)


async def open_buses(config: Config, stack: AsyncExitStack) -> dict[str, ModbusBus]:
    """Open the lines by name; `stack` closes them."""
    buses: dict[str, ModbusBus] = {}
    for name, section in config.bus.items():
        gap_s, timeout_s = section.gap_ms / 1e3, section.timeout_ms / 1e3
        buses[name] = await ModbusBus.open(bus_line(section), gap_s=gap_s, timeout_s=timeout_s)
        stack.push_async_callback(buses[name].close)
    return buses


def bus_line(section: BusSection) -> Line:
    """Return the line a section describes: over TCP where it names a host, else serial."""
    if section.host is not None:
        return TcpLine(section.host, section.tcp_port, section.framing)
    return SerialLine(str(section.port), section.baudrate, section.parity, section.stopbits, section.local_echo)


def check_line_s(config: Config, buses: Mapping[str, ModbusBus]) -> float:
    """Return how long the requests of one check of all four drives take, one after the other."""
    axes = (config.axes.x, config.axes.y, config.axes.z, config.axes.theta)
    return sum(HEALTH_REQUESTS * buses[axis.bus].request_s for axis in axes)


def make_axes(config: Config, buses: Mapping[str, ModbusBus]) -> dict[str, Axis]:
    """Return the four axes on their lines; nothing is asked or moved yet."""
    sections = {name: getattr(config.axes, name) for name in ("x", "y", "z", "theta")}
    # So the drive guards the floor too (607Dh)
    sections["z"] = sections["z"].model_copy(update={"minimum": config.lowest_z_um})
    return {name: Axis(buses[section.bus], axis_config(name, section)) for name, section in sections.items()}


def _gantry(config: Config, buses: Mapping[str, ModbusBus]) -> Gantry:
    axes = make_axes(config, buses)
    limits = GantryConfig(
        safe_z_um=config.gantry.safe_z_um,
        backlash_um=config.gantry.approach_um,
        backlash_theta_deg=config.gantry.approach_deg,
        slow_z_um=config.gantry.highest_surface_um,
        slow_um_s=config.gantry.descent_speed,
        floor_z_um=config.gantry.floor_z_um,
    )
    return Gantry(axes, limits)


def axis_config(name: str, section: AxisSection) -> AxisConfig:
    """Return what the driver of an axis is told of its section."""
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
        vendor_id=section.vendor_id,
        motor_mode=section.motor_mode,
        switch_inputs=section.switch_inputs,
        state_timeout_s=section.state_timeout_ms / 1e3,
        stall_s=section.stall_ms / 1e3,
    )


async def open_lights(section: LightsSection, buses: Mapping[str, ModbusBus], deadline: Deadline) -> Lights:
    """Open the lamps' relay and go dark."""
    settle_s = section.settle_ms / 1e3
    if section.kind == "modbus":
        bus = buses[str(section.bus)]
        return await ModbusRelayLights.open(
            bus, section.address, section.white, section.red, settle_s=settle_s, deadline=deadline
        )
    return await SerialRelayLights.open(
        str(section.port), section.white, section.red, settle_s=settle_s, deadline=deadline
    )


def make_camera(section: CameraSection) -> Camera:
    """Return the camera, not opened yet."""
    config = camera_config(section)
    return StreamCamera(config) if section.kind == "stream" else V4L2Camera(config)


def camera_config(section: CameraSection) -> CameraConfig:
    """Return what the driver of the camera is told of its section."""
    return CameraConfig(
        device=section.device or section.endpoint or "",
        width_px=section.width,
        height_px=section.height,
        encoding=section.encoding,
        exposure_us=section.exposure_us,
        gain=section.gain,
        focus=section.focus,
        white_balance_k=section.white_balance_k,
        frame_timeout_s=section.frozen_ms / 1e3,
        open_timeout_s=section.open_ms / 1e3,
    )


def make_meter(section: MeterSection | None) -> Meter | None:
    """Return the measuring instrument, not connected yet; None where none is configured."""
    return None if section is None else ScpiMeter(meter_settings(section))


async def open_meter(section: MeterSection, deadline: Deadline) -> Meter:
    """Open the measuring instrument; raise MeterError when it does not answer or is another one."""
    return await ScpiMeter.open(meter_settings(section), deadline)


def meter_settings(section: MeterSection) -> MeterSettings:
    """Return what the driver needs; every method is known, those of the section as it says."""
    given = {method: section.methods.get(method, MeterMethodSection()) for method in Method}
    return MeterSettings(
        address=parse_address(section.address),
        methods={
            method: MethodSettings(one.function_of(method), one.range, one.nplc, one.commands, one.read)
            for method, one in given.items()
        },
        baudrate=section.baudrate,
        terminator=section.terminator,
        answer_s=section.answer_ms / 1e3,
        setup=section.setup,
        model=section.model,
        close_channels=section.close_channels,
        open_channels=section.open_channels,
    )
