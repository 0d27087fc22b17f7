"""Sections of what is on the wires: lines, drives, lights, camera."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from daemon.config.sections.base import Finite, NotNegative, Positive, Section


class BusSection(Section):
    """One RS-485 line: a serial port, or a host that carries RTU frames over TCP."""

    port: str | None = Field(
        default=None, description="serial device, best a stable name from udev; or a path below this file's folder"
    )
    baudrate: int = Field(default=115200, ge=1200, le=1_000_000)
    parity: Literal["N", "E", "O"] = "E"
    stopbits: Literal[1, 2] = 1
    host: str | None = Field(default=None, description="instead of a port")
    tcp_port: int = Field(default=502, ge=1, le=65535)
    framing: Literal["rtu", "tcp"] = Field(default="rtu", description="with a host: RTU frames over TCP, or Modbus TCP")
    timeout_ms: float = Field(default=200.0, ge=10, le=5000, description="longest wait for one reply")
    gap_ms: float = Field(default=3.0, ge=0, le=100, description="silence before the next request (manual: 3 ms)")
    local_echo: bool = Field(default=False, description="the adapter hears itself: its echo is taken off each reply")


class ObjectAccessSection(Section):
    """How a drive wants its object dictionary asked (FC 43); the manual leaves these open."""

    index_order: Literal["big", "little"]
    node: int = Field(ge=0, le=247)
    write_flag: int = Field(default=1, ge=0, le=255)


class AxisSection(Section):
    """One drive. Units: um for x, y, z and degrees for theta."""

    bus: str
    address: int = Field(ge=1, le=247)
    increments_per_unit: Finite = Field(description="drive increments per um or degree; negative turns the axis round")
    minimum: Finite = Field(description="lowest allowed coordinate")
    maximum: Finite = Field(description="highest allowed coordinate")
    speed: Positive = Field(description="units per second")
    acceleration: Positive = Field(description="units per second squared")
    homing_method: int = Field(description="6098h; 17, 18: negative, positive limit switch; 19..22: home switch")
    homing_speed: Positive
    homing_position: Finite = Field(default=0.0, description="coordinate of the homing switch")
    word_order: Literal["auto", "big", "little"] = Field(
        default="auto", description="auto: found at start, nothing moves"
    )
    object_access: ObjectAccessSection | None = Field(default=None, description="none: found at start, nothing moves")
    vendor_id: int = Field(default=0x26C, ge=0, le=0xFFFF_FFFF, description="1018h:01; another one is refused at start")
    motor_mode: int | None = Field(
        default=None, ge=0, le=0xFFFF, description="3202h as it has to be; none: anything that can be a motor mode"
    )
    switch_inputs: int | None = Field(
        default=None,
        ge=0,
        le=0xFFFF_FFFF,
        description="3240h:01, written at start; bit 0 negative limit, 1 positive limit, 2 home; none: left as it is",
    )
    state_timeout_ms: float = Field(
        default=500.0, ge=50, le=10_000, description="longest wait for one change of state, mode or set-point"
    )
    stall_ms: float = Field(
        default=2000.0, ge=100, le=60_000, description="standing still this long short of the target is a stall"
    )


class AxesSection(Section):
    """The four axes."""

    x: AxisSection
    y: AxisSection
    z: AxisSection
    theta: AxisSection


class LightsSection(Section):
    """The two rings: a Modbus relay board on a bus, or a serial relay of its own."""

    kind: Literal["modbus", "serial"]
    bus: str | None = None
    address: int = Field(default=1, ge=1, le=255)
    port: str | None = None
    white: int = Field(default=0, ge=0, le=31, description="coil (modbus, from 0) or channel (serial, from 1)")
    red: int = Field(default=1, ge=0, le=31)
    settle_ms: NotNegative = Field(default=40.0, description="relay and lamp are steady after this")
    dark_level: float = Field(
        default=60.0, ge=0.0, le=255.0, description="with both lamps off nothing is brighter; 0: not looked at"
    )


class CameraSection(Section):
    """The camera on the head."""

    kind: Literal["v4l2", "stream"]
    device: str | None = Field(default=None, description="v4l2: path, best a stable name from udev")
    endpoint: str | None = Field(default=None, description="stream: ZeroMQ endpoint of the frame server")
    encoding: Literal["mjpg", "bgr8"] = "mjpg"
    width: int = Field(default=1600, ge=320, le=8192)
    height: int = Field(default=1200, ge=240, le=8192)
    exposure_us: int | None = Field(default=20_000, gt=0, le=1_000_000)
    gain: int | None = None
    focus: int | None = None
    white_balance_k: int | None = Field(default=4600, ge=1000, le=20_000)
    pitch_um: Positive = Field(
        default=12.0, description="about how much one pixel shows at the tip; only a start value"
    )
    timeout_ms: Positive = Field(default=3000.0, description="longest wait for one frame")
    frozen_ms: float = Field(
        default=1000.0, ge=50, le=60_000, description="without a new frame for this long it is opened again"
    )
    open_ms: float = Field(default=10_000.0, ge=500, le=120_000, description="longest wait for it to open")
