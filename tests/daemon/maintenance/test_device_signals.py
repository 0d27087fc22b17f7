"""What lines, camera and drives count and say reaches a watch of that name; nothing is asked for it."""

from types import SimpleNamespace
from typing import Any, cast

from daemon.maintenance.catalogue import all_specs
from daemon.maintenance.device_signals import Devices
from drivers.bus.driver import BusStatistics
from drivers.camera.contract import CameraStatistics
from drivers.l4118 import AxisHealth


def _axis(name: str, **changes: Any) -> AxisHealth:
    facts: dict[str, Any] = {
        "name": name, "state": "operation enabled", "homed": True, "position_units": 0.0, "error_code": 0,
        "error_meaning": "", "warning": False, "negative_limit": False, "positive_limit": False,
        "following_error_units": 0.1,
    }  # fmt: skip
    return AxisHealth(**(facts | changes))


def _hardware(bus: BusStatistics, camera: CameraStatistics, *axes: AxisHealth) -> Any:
    return SimpleNamespace(
        axes=axes, buses={"main": SimpleNamespace(statistics=bus)},
        camera=SimpleNamespace(statistics=lambda: camera), gantry=SimpleNamespace(take_arrivals=lambda: {"x": 0.2}),
    )  # fmt: skip


def test_time_outs_and_garbled_answers_of_a_line_are_told_apart_and_counted_once() -> None:
    devices, bus = Devices(), BusStatistics(requests=1000, timeouts=3, garbled=5)
    hardware = _hardware(bus, CameraStatistics())
    numbers, _ = devices.read(cast("Any", hardware))
    assert (numbers["bus_timeouts_main"], numbers["bus_garbled_main"]) == ([3.0, 1000.0], [5.0, 1000.0])
    bus.requests += 10
    bus.timeouts += 1
    numbers, _ = devices.read(cast("Any", hardware))
    assert (numbers["bus_timeouts_main"], numbers["bus_garbled_main"]) == ([1.0, 10.0], [0.0, 10.0])


def test_pictures_that_never_came_and_those_that_were_dropped_are_two_things() -> None:
    camera = CameraStatistics(grabbed=200, missed=50, undecodable=1, identical=2, timeouts=3, reopened=4)
    numbers, _ = Devices().read(cast("Any", _hardware(BusStatistics(), camera)))
    assert numbers["frames"] == [10.0, 200.0]
    assert numbers["frames_missed"] == [50.0, 250.0]


def test_every_number_of_the_devices_has_a_watch_and_a_hot_drive_says_so() -> None:
    hot = _axis("x", error_code=0x4310, error_meaning="over-temperature", warning=True)
    numbers, words = Devices().read(cast("Any", _hardware(BusStatistics(), CameraStatistics(), hot, _axis("y"))))
    assert set(numbers) <= {spec.name for spec in all_specs(["main"])}
    assert words == {"drive_x": "error 4310h: over-temperature"}
    assert numbers["following_y"] == [0.1]
