"""What the service manager hears, on a real datagram socket; and that nobody listening is no trouble."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from daemon.platform.systemd_notify import STATUS_AT_MOST, Notifier


@pytest.fixture(params=["path", "abstract"])
def manager(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[socket.socket, str]]:
    """A manager's socket and its name, in the file system and in the abstract name space."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as heard:
        path = str(tmp_path / "notify")
        name = f"@{path}" if request.param == "abstract" else path
        heard.bind(b"\0" + path.encode() if name.startswith("@") else path)
        heard.setblocking(False)
        yield heard, name


def _heard(listening: socket.socket) -> list[dict[str, str]]:
    messages = []
    while True:
        try:
            raw = listening.recv(4096).decode()
        except BlockingIOError:
            return messages
        messages.append(dict(line.split("=", 1) for line in raw.splitlines()))


def test_a_life_is_told_in_its_words(manager: tuple[socket.socket, str]) -> None:
    listening, name = manager
    notifier = Notifier.from_environment({"NOTIFY_SOCKET": name, "WATCHDOG_USEC": "10000000"})
    notifier.ready("fault: not_homed")
    notifier.status("idle")
    notifier.feed()
    before_us = time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000
    notifier.reloading()
    notifier.stopping("stopping")
    notifier.close()
    ready, status, fed, reloading, stopping = _heard(listening)
    assert ready == {"READY": "1", "STATUS": "fault: not_homed"}
    assert status == {"STATUS": "idle"}
    assert fed == {"WATCHDOG": "1"}
    assert reloading["RELOADING"] == "1"
    assert int(reloading["MONOTONIC_USEC"]) >= before_us
    assert stopping == {"STOPPING": "1", "STATUS": "stopping"}


def test_the_same_status_is_sent_once_and_never_breaks_a_line(manager: tuple[socket.socket, str]) -> None:
    listening, name = manager
    notifier = Notifier(name)
    notifier.status("two\nREADY=1 lines")
    notifier.status("two READY=1 lines")
    notifier.status("x" * 10_000)
    notifier.close()
    first, long = _heard(listening)
    assert first == {"STATUS": "two READY=1 lines"}
    assert len(long["STATUS"]) == STATUS_AT_MOST


@pytest.mark.parametrize(
    ("environment", "patience_s"),
    [
        ({}, None),
        ({"WATCHDOG_USEC": "10000000"}, 10.0),
        ({"WATCHDOG_USEC": "10000000", "WATCHDOG_PID": str(os.getpid())}, 10.0),
        ({"WATCHDOG_USEC": "10000000", "WATCHDOG_PID": str(os.getpid() + 1)}, None),
        ({"WATCHDOG_USEC": "0"}, None),
        ({"WATCHDOG_USEC": "soon"}, None),
    ],
)
def test_the_watchdog_is_fed_twice_as_often_as_it_must_be_and_only_if_it_is_ours(
    environment: dict[str, str], patience_s: float | None
) -> None:
    notifier = Notifier.from_environment(environment)
    assert notifier.watchdog_s == patience_s
    assert notifier.feed_every_s == (None if patience_s is None else patience_s / 2)


def test_without_a_manager_everything_is_silent() -> None:
    notifier = Notifier.from_environment({"WATCHDOG_USEC": "1000"})
    notifier.ready("idle")
    notifier.feed()
    notifier.close()


def test_a_manager_that_is_gone_or_deaf_stops_nothing(tmp_path: Path) -> None:
    nobody = Notifier(str(tmp_path / "nobody"), 1.0)
    nobody.feed()
    nobody.close()
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as deaf:
        deaf.bind(str(tmp_path / "deaf"))
        notifier = Notifier(str(tmp_path / "deaf"))
        sent = 0
        while not notifier.deaf:
            notifier.status(str(sent))
            sent += 1
        assert deaf.recv(64) == b"STATUS=0"
        notifier.status("heard again")
        assert not notifier.deaf
        notifier.close()
