"""What a station costs that is asked all the time: status requests a second, and what a correction loses by them.

    python -m tests.bench.wire [--corrections N] [--rate PER_S] [--clients N] [--curve]

One simulated station at the clock's own pace. Corrections are run in pairs, one in peace and one while clients, in a
process of their own, ask `status` at a steady pace. Both orders occur equally often, and each pair starts from the same
place, so that what is compared is the load alone. Prints figures; judges nothing.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import random
import statistics
import tempfile
import time
from multiprocessing.connection import Connection
from pathlib import Path

import zmq

from daemon.client import Client
from daemon.wire.curve_keys import new_client, read_private
from tests.bench.idle import cpu_s
from tests.station.rig import Rig, running_rig

REQUEST = json.dumps({"v": 1, "op": "status"}).encode()
WINDOW = 16
"""Requests of one client that may be under way: a tester does not wait for each answer, nor pile up without end."""


def ask(endpoint: str, rate_per_s: float, clients: int, key: Path | None, pipe: Connection) -> None:
    """Ask at a steady pace whenever told to, until told to end; report (answers, refusals, seconds, worst ms)."""
    context = zmq.Context()
    sockets = [_dealer(context, endpoint, key) for _ in range(clients)]
    while pipe.recv() == "go":
        pipe.send(_one_spell(sockets, rate_per_s, pipe))
    for socket in sockets:
        socket.close(linger=0)
    context.term()


def _dealer(context: zmq.Context[zmq.Socket[bytes]], endpoint: str, key: Path | None) -> zmq.Socket[bytes]:
    socket = context.socket(zmq.DEALER)
    if key is not None:
        private = read_private(key)
        socket.curve_publickey, socket.curve_secretkey = private.public.encode(), private.secret.encode()
        socket.curve_serverkey = (private.server or "").encode()
    socket.connect(endpoint)
    return socket


def _one_spell(
    sockets: list[zmq.Socket[bytes]], rate_per_s: float, pipe: Connection
) -> tuple[int, int, float, list[float]]:
    poller = zmq.Poller()
    sent: dict[zmq.Socket[bytes], list[float]] = {}
    for socket in sockets:
        poller.register(socket, zmq.POLLIN)
        sent[socket] = []
    begin_s = time.perf_counter()
    asked, good, bad, waits_ms = 0, 0, 0, list[float]()
    ending = False
    while not ending or any(sent.values()):
        ending = ending or pipe.poll()
        due = int((time.perf_counter() - begin_s) * rate_per_s) - asked
        for socket in sockets if not ending else ():
            while due > 0 and len(sent[socket]) < WINDOW:
                socket.send(REQUEST)
                sent[socket].append(time.perf_counter())
                asked, due = asked + 1, due - 1
        for socket, _ in poller.poll(1):
            ok = b'"ok":true' in socket.recv()
            good, bad = good + ok, bad + (not ok)
            waits_ms.append((time.perf_counter() - sent[socket].pop(0)) * 1e3)
    pipe.recv()
    return good, bad, time.perf_counter() - begin_s, waits_ms


class Load:
    """The asking process."""

    def __init__(self, endpoint: str, rate_per_s: float, clients: int, key: Path | None) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=ask, args=(endpoint, rate_per_s, clients, key, theirs))
        self._process.start()

    def start(self) -> None:
        """Begin to ask."""
        self._pipe.send("go")

    def stop(self) -> tuple[int, int, float, list[float]]:
        """Stop asking; return what was answered."""
        self._pipe.send("stop")
        spell: tuple[int, int, float, list[float]] = self._pipe.recv()
        return spell

    def close(self) -> None:
        """End the process."""
        self._pipe.send("end")
        self._process.join()


def correction(client: Client, rig: Rig, n: int, theta_deg: float) -> tuple[float, int, float]:
    """Run one correction from a fresh placement; return its own total, ms, its moves, and the daemon's CPU share."""
    client.job("place", test_point="TP7", theta_deg=theta_deg)
    cpu, begin_s = cpu_s(rig.daemon.pid), time.perf_counter()
    result = client.job("correct", job_id=f"bench-{n}", test_point="TP7")
    share = (cpu_s(rig.daemon.pid) - cpu) / (time.perf_counter() - begin_s)
    if result.error is not None:
        raise SystemExit(f"the correction failed: {result.error.message}; {result.error.advice}")
    return sum(row["total"] for row in result.timing_ms.values()), result.looks, share


def main() -> None:
    """Measure once."""
    options = argparse.ArgumentParser()
    options.add_argument("--corrections", type=int, default=20, help="pairs")
    options.add_argument("--rate", type=float, default=1000.0, help="status requests a second, all clients together")
    options.add_argument("--clients", type=int, default=4)
    options.add_argument("--curve", action="store_true", help="the clients come with keys")
    chosen = options.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        key = folder / "client.key" if chosen.curve else None
        with running_rig(folder, arguments=()) as rig:
            with rig.client() as client:
                rig.session(client).set_up()
            if key is not None:
                _lock(rig, key)
            measure(rig, key, chosen.corrections, chosen.rate, chosen.clients)


def _lock(rig: Rig, key: Path) -> None:
    """Start the daemon anew, with keys."""
    rig.daemon.end()
    new_client(key.parent / "keys", "bench", "operate", key)
    settings = key.parent / "station.toml"
    settings.write_text(settings.read_text().replace("[api]\n", '[api]\ncurve = true\nkeys_dir = "keys"\n'))

    def idle(_process: object, control: str) -> None:
        with Client(control, timeout_s=60.0, keys=key) as client:
            while client.request("status")["state"] != "idle":
                time.sleep(0.1)

    rig.start_daemon(idle)


def measure(rig: Rig, key: Path | None, pairs: int, rate_per_s: float, clients: int) -> None:
    """Run the pairs and print."""
    random_ = random.Random(1)
    load = Load(rig.control, rate_per_s, clients, key)
    times: dict[bool, list[float]] = {False: [], True: []}
    shares: dict[bool, list[float]] = {False: [], True: []}
    ratios: list[float] = []
    good, bad, seconds, waits_ms = 0, 0, 0.0, list[float]()
    with Client(rig.control, timeout_s=60.0, keys=key) as client:
        for pair in range(pairs):
            theta_deg = random_.uniform(0.0, 100.0)
            found: dict[bool, tuple[float, int, float]] = {}
            for loaded in ((False, True), (True, False))[pair % 2]:
                if loaded:
                    load.start()
                found[loaded] = correction(client, rig, 2 * pair + loaded, theta_deg)
                if loaded:
                    spell = load.stop()
                    good, bad, seconds = good + spell[0], bad + spell[1], seconds + spell[2]
                    waits_ms += spell[3]
            for loaded, (total_ms, looks, share) in found.items():
                times[loaded].append(total_ms / looks)
                shares[loaded].append(share)
            ratios.append(times[True][-1] / times[False][-1])
    load.close()
    waits_ms.sort()
    print(
        f"{good / seconds:.0f} status answers a second by {clients} clients, {bad} refused, {seconds:.0f} s; "
        f"answer within {statistics.median(waits_ms):.2f} ms (median), {waits_ms[int(0.99 * len(waits_ms))]:.1f} ms "
        f"(99 %), {waits_ms[-1]:.0f} ms (worst)"
    )
    print(
        f"a correction, per look: {statistics.median(times[False]):.0f} ms in peace, "
        f"{statistics.median(times[True]):.0f} ms under load; ratio of pairs, median {statistics.median(ratios):.3f}, "
        f"of means {statistics.fmean(times[True]) / statistics.fmean(times[False]):.3f}"
    )
    print(
        f"the daemon's share of a core meanwhile: {statistics.fmean(shares[False]):.2f} and "
        f"{statistics.fmean(shares[True]):.2f}"
    )


if __name__ == "__main__":
    main()
