"""Fault alerts: a needle that may be down stands as an alert until it is known to be up."""

from __future__ import annotations

from typing import Any, cast

from daemon.app.fault_alerts import ALERTS, FaultAlerts
from daemon.config.watch_names import watch_names
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import Event
from daemon.jobs.fault_latch import FaultLatch


class _Flags:
    def __init__(self) -> None:
        self.told: list[tuple[str, str | None]] = []

    def on_flag(self, name: str, message: str | None) -> None:
        self.told.append((name, message))


def test_a_needle_down_behind_another_fault_is_an_alert_until_a_lift_has_come_to_its_end() -> None:
    latch, flags = FaultLatch(), _Flags()
    alerts = FaultAlerts(latch, cast("Any", flags))
    latch.opened()
    alerts.look()
    assert flags.told == [("needle_down", None)], "one that stands from before is cleared"
    latch.latch(Fault(FaultCode.CAMERA_FAILED))
    latch.latch(Fault(FaultCode.NEEDLE_DOWN, "pressed"))
    for _ in range(3):
        alerts.look()
    assert flags.told[1:] == [("needle_down", "pressed")]
    latch.clear([cause for cause in latch.causes if cause.kind is FaultCode.CAMERA_FAILED])
    latch.begin("lift", "a")
    alerts.look()
    latch.end(Event.CANCELLED)
    alerts.look()
    assert flags.told[2:] == [], "a lift that was cancelled has cured nothing"
    latch.begin("lift", "b")
    latch.fire(Event.REFUSED)
    latch.clear(latch.causes)
    latch.end(Event.ON_TARGET)
    alerts.look()
    assert flags.told[2:] == [("needle_down", None)]


def test_every_alert_of_a_fault_is_a_watch() -> None:
    assert set(ALERTS.values()) <= set(watch_names([]))
