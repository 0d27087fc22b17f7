"""A fault's advice ends in what clears it, also where a device gave the advice: its driver knows of no daemon."""

from __future__ import annotations

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.station.device_errors import KINDS
from drivers.errors import DeviceError

LATCHED = [kind for kind in FaultCode if kind.latched]


@pytest.mark.parametrize("kind", LATCHED)
def test_a_fault_that_stays_says_what_clears_it(kind: FaultCode) -> None:
    for fault in (Fault(kind), Fault(kind, advice="Check the cable.")):
        assert kind.way_out.split()[0].strip("`") in fault.advice.lower()
    assert Fault(kind, advice="Check the cable.").advice == f"Check the cable, then {kind.way_out}"


@pytest.mark.parametrize(("raised", "kind"), KINDS)
def test_what_a_driver_says_goes_on_to_what_clears_it(raised: type[DeviceError], kind: FaultCode) -> None:
    advice = Fault(kind, advice=raised.default_advice).advice
    assert kind.way_out.split()[:1] == [] or kind.way_out.split()[0].strip("`") in advice.lower()


def test_a_fault_that_clears_itself_and_advice_that_says_it_already_stay_as_they_are() -> None:
    assert Fault(FaultCode.TIP_NOT_FOUND, advice="Clean it.").advice == "Clean it."
    said = "Look at the axis, then reset and home again."
    assert Fault(FaultCode.MOTION_FAILED, advice=said).advice == said
