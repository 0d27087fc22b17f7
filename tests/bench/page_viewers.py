"""What live pictures cost the daemon: with nobody who looks, with one, and with sixteen, as share of one core.

    python -m tests.bench.page_viewers [SECONDS]

The simulated station runs at its real pace, its white lamp burns. First those who look ask the page, as browsers do:
each fetches the next picture after it has the last. Then sixteen listen at the daemon's own live socket, beside the
page. Prints the daemon's and the page's shares; fails where sixteen at the page cost the daemon more than its budget.
"""

from __future__ import annotations

import http.client
import json
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import zmq

from daemon.client import Client
from daemon.wire.live import TOPIC
from tests.bench.idle import cpu_s
from tests.page.conftest import PageProcess, free_port, write_people
from tests.station.rig import Rig, running_rig

MANY = 16
MOST_SHARE = 0.06
"""Of one core, what live pictures may cost the daemon, however many look."""
LEASE_MS, AGAIN_S, SETTLE_S = 30_000, 20.0, 3.0


class Lamp:
    """The white lamp, kept burning."""

    def __init__(self, rig: Rig) -> None:
        self._rig, self._end = rig, threading.Event()
        self._thread = threading.Thread(target=self._keep)
        self._thread.start()

    def _keep(self) -> None:
        with self._rig.client() as client:
            while True:
                client.request("light", colour="white", lease_ms=LEASE_MS)
                if self._end.wait(AGAIN_S):
                    return

    def end(self) -> None:
        self._end.set()
        self._thread.join()


@contextmanager
def _looking(count: int, look: Callable[[threading.Event, list[int]], None]) -> Iterator[list[int]]:
    """Have so many look, each in a thread of its own; yields how many pictures each has got."""
    end, got = threading.Event(), [[0] for _ in range(count)]
    threads = [threading.Thread(target=look, args=(end, one)) for one in got]
    for thread in threads:
        thread.start()
    pictures: list[int] = []
    try:
        yield pictures
    finally:
        end.set()
        for thread in threads:
            thread.join()
        pictures += [one[0] for one in got]


def _at_the_page(port: int) -> Callable[[threading.Event, list[int]], None]:
    def look(end: threading.Event, got: list[int]) -> None:
        connection, n = http.client.HTTPConnection("127.0.0.1", port, timeout=30.0), 0
        while not end.is_set():
            connection.request("GET", f"/frame.jpg?after={n}")
            answer = connection.getresponse()
            if answer.read() and answer.status == 200:
                n = json.loads(answer.headers["x-frame"])["n"]
                got[0] += 1
        connection.close()

    return look


def _at_the_daemon(endpoint: str) -> Callable[[threading.Event, list[int]], None]:
    def look(end: threading.Event, got: list[int]) -> None:
        context = zmq.Context()
        socket = context.socket(zmq.SUB)
        socket.subscribe(TOPIC)
        socket.connect(endpoint)
        while not end.is_set():
            if socket.poll(200):
                socket.recv_multipart()
                got[0] += 1
        socket.close(linger=0)
        context.term()

    return look


def _measured(rig: Rig, page: PageProcess, seconds: float) -> tuple[float, float]:
    """Return the shares of one core that daemon and page take."""
    assert page.process is not None
    time.sleep(SETTLE_S)
    pids = rig.daemon.pid, page.process.pid
    before, begun_s = [cpu_s(pid) for pid in pids], time.monotonic()
    time.sleep(seconds)
    took_s = time.monotonic() - begun_s
    daemon, own = (max(0.0, cpu_s(pid) - spent) / took_s for pid, spent in zip(pids, before, strict=True))
    return daemon, own


def _all_of_it(rig: Rig, page: PageProcess, client: Client, seconds: float) -> dict[str, float]:
    """Return the daemon's share by who looks."""
    live = client.request("describe")["live"]
    shares: dict[str, float] = {}
    ways = [("nobody", 0, _at_the_page(page.port)), ("one at the page", 1, _at_the_page(page.port)),
            (f"{MANY} at the page", MANY, _at_the_page(page.port)),
            (f"{MANY} at the daemon's socket", MANY, _at_the_daemon(live))]  # fmt: skip
    for name, count, look in ways:
        with _looking(count, look) as pictures:
            daemon, own = _measured(rig, page, seconds)
        shares[name] = daemon
        rate = sum(pictures) / (count * (seconds + SETTLE_S)) if count else 0.0
        print(f"{name}: daemon {daemon:.1%}, page {own:.1%} of a core; {rate:.1f} pictures/s each", flush=True)
    return shares


def main(argv: list[str] | None = None) -> int:
    """Measure all and print it."""
    given = sys.argv[1:] if argv is None else argv
    seconds = float(given[0]) if given else 20.0
    with tempfile.TemporaryDirectory(prefix="reprobe-") as name, running_rig(Path(name), arguments=()) as rig:
        folder = Path(name)
        write_people(folder / "people")
        page = PageProcess(
            rig, SimpleNamespace(), folder / "people", free_port(), rig.control, folder / "page.log", kiosk=True
        )
        with rig.client() as client:
            result = client.job("home")
            assert result.ok, result.error
            lamp = Lamp(rig)
            try:
                page.start()
                shares = _all_of_it(rig, page, client, seconds)
            finally:
                page.end()
                lamp.end()
    cost = shares[f"{MANY} at the page"] - shares["nobody"]
    print(f"{MANY} who look at the page cost the daemon {cost:.1%} of a core; allowed are {MOST_SHARE:.0%}")
    return 1 if cost > MOST_SHARE else 0


if __name__ == "__main__":
    sys.exit(main())
