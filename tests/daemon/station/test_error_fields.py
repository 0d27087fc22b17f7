"""Which fault a driver error becomes, and what its detail holds."""

from __future__ import annotations

from typing import Any

import pytest

from daemon.domain.errors import FaultCode
from daemon.domain.results import ErrorBody
from daemon.station.device_errors import as_fault
from drivers import errors
from drivers.errors import DeviceError


def _refused() -> DeviceError:
    error = errors.DeviceRefused("no", device="y (slave 2 on the line)", code=0x06020000)
    error.axis, error.object = "y", "6085h:00"
    return error


def _silent() -> DeviceError:
    error = errors.LinkTimeout("no answer", device="z (slave 3 on the line)")
    error.axis, error.object = "z", "6064h:00"
    return error


CASES: list[tuple[DeviceError, FaultCode, dict[str, Any]]] = [
    (errors.NotHomed("no reference", device="x"), FaultCode.NOT_HOMED, {"device": "x", "axis": "x"}),
    (errors.NotHomed("no reference on x, y", device="gantry"), FaultCode.NOT_HOMED, {"device": "gantry"}),
    (
        errors.EnvelopeViolation("too far", device="theta"),
        FaultCode.OUTSIDE_ENVELOPE,
        {"device": "theta", "axis": "theta"},
    ),
    (errors.LimitHit("switch", device="z"), FaultCode.LIMIT_HIT, {"device": "z", "axis": "z"}),
    (
        errors.LimitHit("fault", device="z", drive_code=0x8612),
        FaultCode.LIMIT_HIT,
        {"device": "z", "axis": "z", "drive_code": 0x8612},
    ),
    (
        errors.Stalled("blocked", device="y", drive_code=0x7121),
        FaultCode.AXIS_STALLED,
        {"device": "y", "axis": "y", "drive_code": 0x7121},
    ),
    (
        errors.EmergencyStop("supply cut", device="x", drive_code=0x3220),
        FaultCode.EMERGENCY_STOP,
        {"device": "x", "axis": "x", "drive_code": 12832},
    ),
    (errors.EmergencyStop("lost power", device="x"), FaultCode.EMERGENCY_STOP, {"device": "x", "axis": "x"}),
    (
        errors.DriveFault("over-voltage", device="x", code=0x3210),
        FaultCode.MOTION_FAILED,
        {"device": "x", "axis": "x", "drive_code": 0x3210},
    ),
    (errors.DriveFault("unread", device="x", code=0), FaultCode.MOTION_FAILED, {"device": "x", "axis": "x"}),
    (errors.MotionTimeout("late", device="gantry"), FaultCode.MOTION_FAILED, {"device": "gantry"}),
    (errors.MotionError("no", device="theta"), FaultCode.MOTION_FAILED, {"device": "theta", "axis": "theta"}),
    (
        _refused(),
        FaultCode.DEVICE_REFUSED,
        {"device": "y (slave 2 on the line)", "axis": "y", "object": "6085h:00", "exception": 0x06020000},
    ),
    (
        errors.DeviceRefused("no", device="slave 9", code=2),
        FaultCode.DEVICE_REFUSED,
        {"device": "slave 9", "exception": 2},
    ),
    (
        _silent(),
        FaultCode.LINK_LOST,
        {"device": "z (slave 3 on the line)", "axis": "z", "object": "6064h:00"},
    ),
    (errors.ReplyError("garbled", device="bus"), FaultCode.LINK_LOST, {"device": "bus"}),
    (errors.DeadlinePassed("late", device="bus"), FaultCode.LINK_LOST, {"device": "bus"}),
    (errors.CameraTimeout("none", device="camera"), FaultCode.CAMERA_FAILED, {"device": "camera"}),
    (errors.FrameLost("torn", device="camera"), FaultCode.CAMERA_FAILED, {"device": "camera"}),
    (errors.LightError("dark", device="lights"), FaultCode.LIGHT_FAILED, {"device": "lights"}),
    (
        errors.MeterTimeout("no answer", errors.MeterTrouble.SILENT),
        FaultCode.METER_FAILED,
        {"device": "meter", "trouble": "silent"},
    ),
    (
        errors.MeterError("unknown words", errors.MeterTrouble.DIALECT, code=-113),
        FaultCode.METER_FAILED,
        {"device": "meter", "trouble": "dialect", "exception": -113},
    ),
]


@pytest.mark.parametrize(("error", "kind", "detail"), CASES, ids=lambda case: type(case).__name__)
def test_an_error_becomes_a_fault_with_all_that_is_known_of_it(
    error: DeviceError, kind: FaultCode, detail: dict[str, Any]
) -> None:
    fault = as_fault(error)
    assert fault.kind is kind
    assert fault.message == str(error)
    assert fault.detail == {**detail, "advice": error.advice}


def test_registers_stand_in_detail_and_not_in_the_sentence() -> None:
    """A sentence is for who runs the station at night; who mends the drive asks for more."""
    error = errors.MotionTimeout("the drive did not take its target", device="x", technical="status 0237h")
    fault = as_fault(error)
    assert fault.message == "x: the drive did not take its target"
    assert fault.detail["technical"] == "status 0237h"
    assert str(error) == "x: the drive did not take its target (status 0237h)", "as logs and `doctor` have it"


def test_the_fields_are_on_the_wire_and_advice_stays_where_it_was() -> None:
    body = ErrorBody.of(as_fault(errors.EmergencyStop("supply cut", device="x", drive_code=0x3220))).model_dump()
    assert body["code"] == 5105
    assert body["detail"] == {"device": "x", "axis": "x", "drive_code": 0x3220}
    assert body["advice"].startswith("Release the emergency stop")


def test_every_class_of_driver_errors_is_among_the_cases() -> None:
    """Those left out have no field of their own and the code of a class that is in."""
    left_out = {errors.LinkError, errors.CameraError, DeviceError}
    assert _classes(DeviceError) - {type(error) for error, _, _ in CASES} == left_out


def _classes(base: type[DeviceError]) -> set[type[DeviceError]]:
    return {base}.union(*(_classes(child) for child in base.__subclasses__()))
