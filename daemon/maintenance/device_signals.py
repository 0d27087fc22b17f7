"""Signals of drives, lines and camera: counts since the last time, the drives' own words, arrivals."""

from __future__ import annotations

from daemon.maintenance.signals import AxisWords, Counters, Numbers, of_axes
from daemon.station.devices import Hardware


class Devices:
    """Reads what the devices have counted already; asks nothing over a wire."""

    def __init__(self) -> None:
        self._counters = Counters()

    def read(self, hardware: Hardware) -> tuple[Numbers, dict[str, str]]:
        """Return the devices' numbers and the drives' own words."""
        axes = [
            AxisWords(axis.name, axis.warning, _error(axis.error_code, axis.error_meaning), axis.following_error_units)
            for axis in hardware.axes
        ]
        numbers, words = of_axes(axes, hardware.gantry.take_arrivals())
        for name, bus in hardware.buses.items():
            counts = bus.statistics
            for kind, errors in (("timeouts", counts.timeouts), ("garbled", counts.garbled)):
                stream = f"bus_{kind}_{name}"
                numbers[stream] = self._counters.since(stream, errors, counts.requests)
        camera = hardware.camera.statistics()
        lost = camera.undecodable + camera.identical + camera.timeouts + camera.reopened
        numbers["frames"] = self._counters.since("camera", lost, camera.grabbed)
        numbers["frames_missed"] = self._counters.since("missed", camera.missed, camera.grabbed + camera.missed)
        return numbers, words


def _error(code: int, meaning: str) -> str:
    return f"error {code:04X}h: {meaning or 'no entry in the error stack'}" if code else ""
