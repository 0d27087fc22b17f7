"""Faults that stand for the drivers' errors, most specific first.

`detail` has `device`, what the driver calls it, and of these what is known of the error:

| field | type | what it is |
|---|---|---|
| `axis` | string | `x`, `y`, `z` or `theta` |
| `drive_code` | integer | the drive's own error code, object 603Fh: 12832 is 3220h of its manual |
| `object` | string | the drive's object that was read or written, index and subindex: `6041h:00` |
| `exception` | integer | why it was refused: below 0 of SCPI, below 256 of Modbus, else an SDO abort code |
| `technical` | string | registers, function codes and status words, for who mends the drive or the line |
| `trouble` | string | of a meter (`drivers.errors.MeterTrouble`): `silent`, `slow`, `garbage`, `dialect` and so on |

What counts as an emergency stop is decided in `drivers.l4118.diagnosis` alone; here it only gets its code.
"""

from __future__ import annotations

from daemon.domain.errors import Fault, FaultCode
from drivers import errors
from drivers.gantry import AXES

KINDS: tuple[tuple[type[errors.DeviceError], FaultCode], ...] = (
    (errors.NotHomed, FaultCode.NOT_HOMED),
    (errors.EnvelopeViolation, FaultCode.OUTSIDE_ENVELOPE),
    (errors.LimitHit, FaultCode.LIMIT_HIT),
    (errors.Stalled, FaultCode.AXIS_STALLED),
    (errors.EmergencyStop, FaultCode.EMERGENCY_STOP),
    (errors.MotionError, FaultCode.MOTION_FAILED),
    (errors.CameraError, FaultCode.CAMERA_FAILED),
    (errors.LightError, FaultCode.LIGHT_FAILED),
    (errors.MeterError, FaultCode.METER_FAILED),
    (errors.DeviceRefused, FaultCode.DEVICE_REFUSED),
    (errors.DeviceError, FaultCode.LINK_LOST),
)


def as_fault(error: Exception) -> Fault:
    """Return the fault that stands for `error`, the most specific one; what nobody expected is `internal`."""
    if isinstance(error, Fault):
        return error
    if isinstance(error, errors.DeviceError):
        kind = next(kind for raised, kind in KINDS if isinstance(error, raised))
        return Fault(kind, error.in_words, device=error.device, advice=error.advice, **_fields(error))
    return Fault(FaultCode.INTERNAL, f"{type(error).__name__}: {error}")


def _fields(error: errors.DeviceError) -> dict[str, str | int]:
    """Return what is known of the error; one whose device is an axis is about that axis."""
    axis = {"axis": error.device} if error.device in AXES else {}
    technical = {"technical": error.technical} if error.technical else {}
    return {**axis, **error.fields(), **technical}


def forget_frames(error: BaseException) -> None:
    """Let go of where an error came from, and what caused it: every frame on the way holds its pictures.

    An error and the frames it passed refer to each other, so that without this tens of megabytes of a failed job would
    stay until the collector of cycles comes by, or, where the error closes the station, until it is cleared.
    """
    seen: set[int] = set()
    open_ones: list[BaseException | None] = [error]
    while open_ones:
        one = open_ones.pop()
        if one is not None and id(one) not in seen:
            seen.add(id(one))
            one.__traceback__ = None
            open_ones += [one.__cause__, one.__context__]
            if isinstance(one, BaseExceptionGroup):
                open_ones += one.exceptions
