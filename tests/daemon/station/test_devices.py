"""What the configuration says is what the drivers are told; what the drives say is what the station is told."""

from __future__ import annotations

import re
from contextlib import AsyncExitStack
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from daemon.config.model import Config, ConfigError, load_config
from daemon.station import devices as hardware
from drivers.bus import OdAddressing, SerialLine, TcpLine
from drivers.deadline import Deadline
from drivers.errors import DriveFault, EmergencyStop, LimitHit, MotionError
from drivers.l4118 import HEALTH_REQUESTS, AxisHealth
from drivers.l4118.diagnosis import Evidence
from drivers.meter import Function, Method, MethodSettings, SerialAddress, TcpAddress
from tests.drivers.peers.instrument import Instrument, Script, TcpPeer

EXAMPLE = Path(__file__).parents[3] / "systemd" / "station.example.toml"


def _config(tmp_path: Path, *changes: tuple[str, str]) -> Config:
    text = EXAMPLE.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    (tmp_path / "station.toml").write_text(text)
    return load_config(tmp_path / "station.toml")


def test_a_serial_line_and_one_over_tcp(tmp_path: Path) -> None:
    config = _config(tmp_path)
    assert hardware.bus_line(config.bus["main"]) == SerialLine("/dev/reprobe-bus", 115200, "E", 1)
    gateway = 'host = "127.0.0.1"\ntcp_port = 4001'
    config = _config(tmp_path, ('port = "/dev/reprobe-bus"', gateway))
    assert hardware.bus_line(config.bus["main"]) == TcpLine("127.0.0.1", 4001, "rtu")


def test_open_points_of_a_drive_can_be_fixed(tmp_path: Path) -> None:
    settled = 'word_order = "little"\nobject_access = { index_order = "little", node = 0 }\naddress = 1'
    axis = hardware.axis_config("x", _config(tmp_path, ("address = 1", settled)).axes.x)
    assert (axis.word_order, axis.addressing) == ("little", OdAddressing("little", 0, 1))
    assert hardware.axis_config("y", _config(tmp_path).axes.y).addressing is None


def test_what_differs_from_drive_to_drive_is_configured(tmp_path: Path) -> None:
    lines = "vendor_id = 0x2A7\nmotor_mode = 8\nswitch_inputs = 7\nstate_timeout_ms = 900\nstall_ms = 700\naddress = 1"
    axis = hardware.axis_config("x", _config(tmp_path, ("address = 1", lines)).axes.x)
    assert (axis.vendor_id, axis.motor_mode, axis.switch_inputs) == (0x2A7, 8, 7)
    assert (axis.state_timeout_s, axis.stall_s) == (0.9, 0.7)
    usual = hardware.axis_config("x", _config(tmp_path).axes.x)
    assert (usual.vendor_id, usual.motor_mode, usual.switch_inputs) == (0x26C, None, None)
    assert (usual.state_timeout_s, usual.stall_s) == (0.5, 2.0)


def test_an_adapter_that_hears_itself_and_the_times_of_a_camera_are_configured(tmp_path: Path) -> None:
    config = _config(
        tmp_path, ('parity = "E"', 'parity = "E"\nlocal_echo = true'),
        ("exposure_us = 20000", "exposure_us = 20000\nfrozen_ms = 2500\nopen_ms = 30000"),
    )  # fmt: skip
    assert hardware.bus_line(config.bus["main"]) == SerialLine("/dev/reprobe-bus", 115200, "E", 1, local_echo=True)
    assert (config.camera.frozen_ms, config.camera.open_ms) == (2500, 30_000)
    assert hardware.camera_config(config.camera).frame_timeout_s == 2.5
    assert hardware.camera_config(config.camera).open_timeout_s == 30.0


class Bus:
    """A line on which every request takes as long as is said."""

    def __init__(self, request_s: float) -> None:
        self.request_s = request_s


def test_the_time_of_a_check_follows_the_number_of_requests_and_the_speed_of_each_line(tmp_path: Path) -> None:
    config = _config(tmp_path)
    slow = hardware.check_line_s(config, cast("Any", {"main": Bus(0.08)}))
    assert slow == pytest.approx(4 * HEALTH_REQUESTS * 0.08)


def test_theta_arrives_within_hundredths_of_a_degree(tmp_path: Path) -> None:
    axes = _config(tmp_path).axes
    assert hardware.axis_config("theta", axes.theta).window_units < 0.05625
    assert hardware.axis_config("x", axes.x).window_units == 1.0


# --- what the drives say

SOON = Deadline.after(60.0)
RUNS, OFF, FAULT = Evidence(0x0237), Evidence(0x0250, left_enabled=True), Evidence(0x0218, 0x3210, 0x01003210)


def _health(name: str, evidence: Evidence, *, homed: bool = True, on_limit: bool = False) -> AxisHealth:
    return AxisHealth(name, "any", homed, 0.0, evidence.error_code, "", False, on_limit, False, None, evidence)


class Machine:
    """A gantry and lights that say what they are told to, and write down what was asked of them."""

    def __init__(self, *axes: AxisHealth) -> None:
        self._axes = axes
        self.did: list[str] = []

    async def health(self, _deadline: Deadline) -> tuple[AxisHealth, ...]:
        return self._axes

    async def reset(self, _deadline: Deadline) -> None:
        self.did.append("reset")

    async def start(self, _deadline: Deadline) -> None:
        self.did.append("start")

    async def set(self, _light: object, _deadline: Deadline) -> float:
        self.did.append("dark")
        return 0.0

    async def check(self, _deadline: Deadline) -> None:
        self.did.append("asked whether it is dark")


def _opened(machine: Machine) -> hardware.Hardware:
    anything = cast("Any", machine)
    return hardware.Hardware(anything, anything, anything, {}, AsyncExitStack(), {})


@pytest.mark.parametrize(
    ("axes", "error", "device"),
    [
        ([_health("x", RUNS), _health("y", OFF)], EmergencyStop, "y"),
        ([_health("x", FAULT), _health("y", OFF)], EmergencyStop, "y"),
        ([_health("x", RUNS, on_limit=True), _health("y", OFF)], EmergencyStop, "y"),
        ([_health("x", RUNS), _health("y", FAULT), _health("z", RUNS, on_limit=True)], DriveFault, "y"),
        ([_health("x", RUNS), _health("z", RUNS, on_limit=True)], LimitHit, "z"),
    ],
)
async def test_of_several_troubles_an_emergency_stop_is_told_first_then_the_first(
    axes: list[AxisHealth], error: type[MotionError], device: str
) -> None:
    station = _opened(Machine(*axes))
    with pytest.raises(error) as caught:
        await station.check_health(SOON)
    assert type(caught.value) is error
    assert caught.value.device == device
    assert station.axes == tuple(axes)


async def test_healthy_axes_are_no_trouble_nor_one_on_its_switch_before_homing() -> None:
    await _opened(Machine(_health("x", RUNS), _health("y", RUNS, homed=False, on_limit=True))).check_health(SOON)


@pytest.mark.parametrize(("evidence", "trouble"), [(RUNS, False), (FAULT, True), (OFF, True)])
async def test_a_drive_that_was_switched_off_is_in_trouble_though_it_shows_no_error_code(
    evidence: Evidence, *, trouble: bool
) -> None:
    station = _opened(Machine(_health("x", RUNS), _health("y", evidence)))
    assert await station.in_trouble(SOON) is trouble


async def test_recovery_clears_the_drives_before_it_starts_them_and_ends_in_the_dark() -> None:
    machine = Machine(_health("x", RUNS))
    await _opened(machine).recover(SOON)
    assert machine.did == ["reset", "start", "dark"]


def test_the_drive_of_z_is_told_the_floor_as_its_lower_limit(tmp_path: Path) -> None:
    """5000 nominal, less 500 of range and 300 of overtravel; the axis' own minimum where that is higher."""
    buses = cast("Any", {"main": SimpleNamespace(label=lambda _address, _name: None)})
    axes = hardware.make_axes(_config(tmp_path), buses)
    assert axes["z"].config.min_units == 4200.0
    assert (axes["x"].config.min_units, axes["theta"].config.min_units) == (0.0, -220.0)
    higher = _config(tmp_path, ("minimum = 0.0\nmaximum = 30000.0", "minimum = 4500.0\nmaximum = 30000.0"))
    assert hardware.make_axes(higher, buses)["z"].config.min_units == 4500.0


METER = """
[meter]
kind = "scpi"
address = "{address}"
answer_ms = 1500
terminator = "crlf"
setup = ["SYST:REM"]
channels = {{ CLK = 101 }}
contact_channel = 1
[meter.methods.contact]
range = 100.0
nplc = 0.2
[meter.methods.diode]
commands = ["FUNC DIODE"]
read = "VAL?"
"""


def _metered(tmp_path: Path, address: str, *changes: tuple[str, str]) -> Config:
    return _config(tmp_path, *changes, ("[board]", METER.format(address=address) + "[board]"))


def test_a_meter_is_told_what_its_section_says(tmp_path: Path) -> None:
    section = _metered(tmp_path, "dmm.lab:5025").meter
    assert section is not None
    settings = hardware.meter_settings(section)
    assert settings.address == TcpAddress("dmm.lab", 5025)
    assert (settings.answer_s, settings.terminator, settings.setup) == (1.5, "crlf", ("SYST:REM",))
    assert (section.channels, section.contact_channel) == ({"CLK": 101}, 1)
    assert set(settings.methods) == set(Method)
    assert settings.methods[Method.CONTACT] == MethodSettings(Function.RESISTANCE, 100.0, 0.2)
    assert settings.methods[Method.DIODE] == MethodSettings(Function.DIODE, commands=("FUNC DIODE",), read="VAL?")
    assert settings.methods[Method.CAPACITANCE] == MethodSettings(Function.CAPACITANCE)


def test_a_meter_may_be_on_a_serial_port_or_not_there(tmp_path: Path) -> None:
    section = _metered(tmp_path, "/dev/ttyUSB0").meter
    assert section is not None
    assert hardware.meter_settings(section).address == SerialAddress("/dev/ttyUSB0")
    assert _config(tmp_path).meter is None


async def test_a_meter_is_opened_by_its_section(tmp_path: Path) -> None:
    peer = TcpPeer(Instrument(Script()))
    section = _metered(tmp_path, str(await peer.open())).meter
    assert section is not None
    meter = await hardware.open_meter(section, Deadline.after(30.0))
    assert meter.identity.model == "DMM-7"
    await meter.close()
    await peer.close()


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('"dmm.lab:5025"', '"dmm.lab"', "neither host:port"),
        ('kind = "scpi"', 'kind = "gpib"', "it should be 'scpi'"),
        ("[meter.methods.contact]", "[meter.methods.touching]", "meter.methods.touching"),
        ("range = 100.0", "range = -1.0", "greater than 0"),
        ("range = 100.0", 'function = "capacitance"', "contact: capacitance has no nplc"),
        ('read = "VAL?"', "range = 1.0", "belong into them"),
        ('["SYST:REM"]', r'["SYST\nREM"]', "meter.setup"),
        ('terminator = "crlf"', 'close_channels = "CLOSE ALL"', "has no {channels}"),
        ("answer_ms = 1500", "answer_ms = 0", "greater than or equal to 10"),
    ],
)
def test_a_meter_that_cannot_be_meant_is_refused_by_its_path(tmp_path: Path, old: str, new: str, says: str) -> None:
    meter = METER.format(address="dmm.lab:5025")
    assert old in meter
    (tmp_path / "station.toml").write_text(EXAMPLE.read_text() + meter.replace(old, new, 1))
    with pytest.raises(ConfigError, match=re.escape(says)):
        load_config(tmp_path / "station.toml")
