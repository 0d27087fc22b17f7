"""One axis of the machine: a stepper drive with CiA 402 over Modbus."""

from drivers.l4118.contract import (
    HEALTH_REQUESTS,
    AxisConfig,
    AxisFindings,
    AxisHealth,
    AxisIdentity,
    AxisStatus,
    HomingConfig,
)
from drivers.l4118.driver import Axis
from drivers.l4118.objects import PowerState

__all__ = [
    "HEALTH_REQUESTS",
    "Axis",
    "AxisConfig",
    "AxisFindings",
    "AxisHealth",
    "AxisIdentity",
    "AxisStatus",
    "HomingConfig",
    "PowerState",
]
