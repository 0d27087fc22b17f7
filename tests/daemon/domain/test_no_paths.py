"""What goes over the wire names files and devices, and not where they lie."""

from __future__ import annotations

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.no_paths import without_paths
from daemon.domain.results import ErrorBody


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("/dev/serial/by-id/usb-FTDI_1-port0: no answer to FC 43", "usb-FTDI_1-port0: no answer to FC 43"),
        ("No space left on device: /var/lib/reprobe/pictures/", "No space left on device: pictures"),
        ("'/etc/reprobe/station.toml' and /dev/ttyUSB0", "'station.toml' and ttyUSB0"),
        ("at /run/a/b, then (/tmp/c/d)", "at b, then (d)"),
        ("150 mm/s is more than 100 mm/s", "150 mm/s is more than 100 mm/s"),
        ("see tcp://127.0.0.1:5555/x/y", "see tcp://127.0.0.1:5555/x/y"),
        ("6041h:00 / 6040h:00", "6041h:00 / 6040h:00"),
        ("either/or, n/a", "either/or, n/a"),
        ("", ""),
    ],
)
def test_a_path_is_told_by_its_last_name_and_nothing_else_changes(text: str, told: str) -> None:
    assert without_paths(text) == told


def test_an_error_tells_its_device_as_a_fact_and_no_path_in_its_sentence() -> None:
    fault = Fault(
        FaultCode.LINK_LOST, "/dev/ttyUSB0: silent", device="/dev/ttyUSB0", axis="x", advice="see /dev/ttyUSB0"
    )
    body = ErrorBody.of(fault)
    assert (body.message, body.advice) == ("ttyUSB0: silent", "see ttyUSB0, then `reset`")
    assert body.detail == {"device": "/dev/ttyUSB0", "axis": "x"}
