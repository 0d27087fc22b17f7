"""From what the drivers raise to the faults of the wire, most specific first."""

from __future__ import annotations

from daemon.faults import Fault, Kind
from drivers import errors

_KINDS: tuple[tuple[type[errors.DeviceError], Kind], ...] = (
    (errors.NotHomed, Kind.NOT_HOMED),
    (errors.EnvelopeViolation, Kind.OUTSIDE_ENVELOPE),
    (errors.LimitHit, Kind.LIMIT_HIT),
    (errors.Stalled, Kind.AXIS_STALLED),
    (errors.EmergencyStop, Kind.EMERGENCY_STOP),
    (errors.MotionError, Kind.MOTION_FAILED),
    (errors.CameraError, Kind.CAMERA_FAILED),
    (errors.LightError, Kind.LIGHT_FAILED),
    (errors.DeviceRefused, Kind.DEVICE_REFUSED),
    (errors.DeviceError, Kind.LINK_LOST),
)


def as_fault(error: Exception) -> Fault:
    """Return the fault that stands for `error`; what nobody expected is `internal`."""
    if isinstance(error, Fault):
        return error
    if isinstance(error, errors.DeviceError):
        kind = next(kind for raised, kind in _KINDS if isinstance(error, raised))
        return Fault(kind, str(error), device=error.device, advice=error.advice)
    return Fault(Kind.INTERNAL, f"{type(error).__name__}: {error}")
