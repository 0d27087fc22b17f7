"""Testers of every kind at a station, what they hear, and whom it lets in."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

import pytest
import zmq

from daemon.client import Client, NoAnswer, NotLetIn, Refused, Subscription
from daemon.tools.demo.processes import Process
from tests.station.rig import EVENTUALLY_S, ROOT, Rig

NODE = Path(__file__).parent / "node"
README_ENDPOINT = "tcp://127.0.0.1:5555"
NO_REGISTRY = re.compile(r"code (ENOTFOUND|EAI_AGAIN|ECONN\w+|ETIMEDOUT|ENETUNREACH|ERR_SOCKET_TIMEOUT|E40[13]|E5\d\d)")
SAYS = re.compile(r"(corrected|already_on_target) [\d.]+ -> [\d.]+ um\n")


def _readme(language: str, endpoint: str) -> str:
    """Return the README's client as it stands there, but for the address of the station."""
    (text,) = (
        code
        for code in re.findall(rf"```{language}\n(.*?)```", (ROOT / "README.md").read_text(), flags=re.DOTALL)
        if README_ENDPOINT in code and "correct" in code
    )
    assert text.count(README_ENDPOINT) == 1
    return text.replace(README_ENDPOINT, endpoint)


def _run(*command: str, folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=100, check=False)


# --- clients --------------------------------------------------------------------------------------------------


def test_the_readmes_client_in_python_does_what_it_says(rig: Rig, client: Client, tmp_path: Path) -> None:
    client.job("place", test_point="TP7", theta_deg=0.0)
    done = _run(sys.executable, "-c", _readme("python", rig.control), folder=tmp_path)
    assert SAYS.fullmatch(done.stdout), done.stderr
    again = _run(sys.executable, "-c", _readme("python", rig.control), folder=tmp_path)
    assert again.stdout == done.stdout, "the same id is answered the same way"
    other = _readme("python", rig.control).replace('"TP7"', '"TP8"')
    refused = _run(sys.executable, "-c", other, folder=tmp_path)
    assert "was used for a different request; use a fresh id" in refused.stderr


@pytest.fixture(scope="module")
def node(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which Node finds its zeromq."""
    if not (shutil.which("node") and shutil.which("npm")):
        pytest.skip("node and npm are not here")
    folder = tmp_path_factory.mktemp("node")
    for file in NODE.iterdir():
        shutil.copy(file, folder)
    # What it brings is built already; nothing it would like to run at installing is needed.
    options = ("--ignore-scripts", "--no-audit", "--no-fund", "--fetch-retries=1", "--fetch-timeout=20000")
    done = _run("npm", "ci", *options, folder=folder)
    if trouble := NO_REGISTRY.search(done.stderr):
        pytest.skip(f"the registry of npm cannot be reached: {trouble[0]}")
    assert done.returncode == 0, done.stderr
    return folder


def test_the_readmes_client_in_node_does_what_it_says(rig: Rig, client: Client, node: Path) -> None:
    client.job("place", test_point="TP7", theta_deg=0.0)
    (node / "tester.js").write_text(_readme("js", rig.control))
    done = _run("node", "tester.js", folder=node)
    assert SAYS.fullmatch(done.stdout), done.stderr


class Forgetful:
    """A daemon that is killed before it answers: it hears every request, and answers from the second on."""

    def __init__(self, endpoint: str) -> None:
        self.heard: list[dict[str, Any]] = []
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.ROUTER)
        self._socket.bind(endpoint)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        self._socket.close(linger=0)
        self._context.term()

    def _serve(self) -> None:
        result = {"outcome": "corrected", "error_before_um": 181.0, "error_after_um": 9.0, "error": None}
        while not self._stop.is_set():
            if self._socket.poll(20):
                *route, body = self._socket.recv_multipart()
                self.heard.append(json.loads(body))
                if len(self.heard) > 1:
                    self._socket.send_multipart([*route, json.dumps({"ok": True, "result": result}).encode()])


def test_the_readmes_client_in_python_asks_again_with_the_same_id(tmp_path: Path) -> None:
    endpoint = f"ipc://{tmp_path}/control"
    with Forgetful(endpoint) as station:
        done = _run(sys.executable, "-c", _readme("python", endpoint).replace("5_000", "500"), folder=tmp_path)
    assert SAYS.fullmatch(done.stdout), done.stderr
    assert len(station.heard) >= 2
    assert all(request == station.heard[0] for request in station.heard)


def test_the_readmes_client_in_node_asks_again_with_the_same_id(tmp_path: Path, node: Path) -> None:
    endpoint = f"ipc://{tmp_path}/control"
    with Forgetful(endpoint) as station:
        (node / "again.js").write_text(_readme("js", endpoint).replace("5000", "500"))
        done = _run("node", "again.js", folder=node)
    assert SAYS.fullmatch(done.stdout), done.stderr
    assert len(station.heard) >= 2
    assert all(request == station.heard[0] for request in station.heard)


def test_a_dealer_has_many_requests_under_way_and_finds_its_answers_by_id(rig: Rig) -> None:
    context = zmq.Context()
    dealer = context.socket(zmq.DEALER)
    dealer.connect(rig.control)
    try:
        sent = [f"dealer-{n}" for n in range(3)]
        for job_id in sent:
            dealer.send_json({"v": 1, "op": "look", "id": job_id, "wait": True})
        dealer.send_json({"v": 1, "op": "status"})
        replies = [_received(dealer) for _ in range(4)]
        assert replies[0]["state"], "what needs no waiting does not wait behind what does"
        assert [(reply["id"], reply["result"]["ok"]) for reply in replies[1:]] == [(job_id, True) for job_id in sent]
    finally:
        dealer.close(linger=0)
        context.term()


def _received(socket: zmq.Socket[bytes]) -> dict[str, Any]:
    assert socket.poll(20_000), "no answer"
    reply: dict[str, Any] = json.loads(socket.recv_multipart()[-1])
    return reply


def test_testers_take_turns_and_one_that_floods_is_refused(rig: Rig, client: Client) -> None:
    limits = client.request("describe")["limits"]
    mine = [f"flood-{n}" for n in range(limits["queue_per_client"] + 1)]
    with rig.client() as other, Subscription(rig.events, ("result", "heartbeat")) as heard:
        assert heard.next(10.0), "a heartbeat comes by itself"
        client.request("place", id="long", board_um=[39_000.0, 29_000.0], theta_deg=90.0)
        give_up_s = time.monotonic() + EVENTUALLY_S
        while client.request("status")["state"] == "idle":  # what has begun waits no more
            assert time.monotonic() < give_up_s, "it does not begin"
            time.sleep(0.01)
        for job_id in mine[:-1]:
            client.request("look", id=job_id)
        with pytest.raises(Refused) as refused:
            client.request("look", id=mine[-1])
        assert refused.value.error["name"] == "busy"
        assert refused.value.error["detail"]["limit_per_client"] == limits["queue_per_client"]
        other.request("look", id="other")
        ended: list[str] = []
        while "other" not in ended or mine[-2] not in ended:
            event = heard.next(EVENTUALLY_S)
            assert event is not None, ended
            if event["topic"] == "result":
                ended.append(event["id"])
    assert ended.index("other") < ended.index(mine[2]), "the other's turn came behind one or two of the flood, not all"


# --- events -------------------------------------------------------------------------------------------------


def test_events_have_no_gaps_and_results_can_be_replayed(rig: Rig, client: Client) -> None:
    context = zmq.Context()
    socket = context.socket(zmq.SUB)
    socket.subscribe("")
    socket.connect(rig.events)
    try:
        assert socket.poll(10_000), "a heartbeat comes by itself"
        client.job("place", test_point="TP1", theta_deg=0.0)
        result = client.job("correct", test_point="TP1")
        seqs, states, published = [], [], None
        while published is None:
            assert socket.poll(10_000)
            topic, body = socket.recv_multipart()
            event = json.loads(body)
            assert event["topic"] == topic.decode()
            assert {"seq", "time", "station", "v"} <= event.keys()
            seqs.append(event["seq"])
            if event["topic"] == "state":
                states.append(event["state"])
            if event["topic"] == "result" and event["id"] == result.id:
                published = event
        assert seqs == list(range(seqs[0], seqs[0] + len(seqs)))
        assert states[-1] == "idle"
        assert {"triggered", "look"} <= set(states)
        assert published["seq"] == result.seq
        replay = client.request("results", since=result.seq)["results"]
        assert [r["id"] for r in replay][:1] == [result.id]
        snapshot = client.request("snapshot")
        assert snapshot["last_result"]["id"] == result.id
        assert snapshot["next_seq"] > result.seq
    finally:
        socket.close(linger=0)
        context.term()


def test_a_report_is_added_up(client: Client) -> None:
    before = client.request("snapshot")["touches"]
    assert client.request("report", touches=20)["touches"] == before + 20


# --- keys -----------------------------------------------------------------------------------------------------


def _reprobe(*arguments: str) -> subprocess.CompletedProcess[str]:
    return _run(sys.executable, "-m", "daemon.cli", *arguments, folder=ROOT)


@contextmanager
def _with_settings(rig: Rig, old: str, new: str) -> Iterator[None]:
    """Run the daemon on other settings for a while."""
    settings = rig.places.out / "station.toml"
    before = settings.read_text()
    assert rig.daemon.end() == 0, rig.daemon.last_words()
    assert old in before
    settings.write_text(before.replace(old, new))
    try:
        yield
    finally:
        rig.daemon.end()
        settings.write_text(before)
        rig.start_daemon()


def _until_idle(key: Path) -> Callable[[Process, str], None]:
    def wait(process: Process, control: str) -> None:
        with Client(control, timeout_s=1.0, keys=key) as client:
            give_up_s = time.monotonic() + 60.0
            while time.monotonic() < give_up_s:
                assert process.alive(), process.last_words()
                try:
                    if client.request("status")["state"] == "idle":
                        return
                except NoAnswer:
                    continue
                time.sleep(0.02)  # who asks without a pause is refused after 2,000 times, where a start is slow
        raise AssertionError(process.last_words())

    return wait


def test_a_station_with_keys_from_first_to_last(rig: Rig) -> None:
    """One long story, for a daemon takes seconds to start."""
    folder, out = rig.places.out / "keys", rig.places.out
    for name, role in (("eye", "observe"), ("tester", "operate"), ("keeper", "maintain")):
        made = _reprobe("keys", "new", name, "--role", role, "--keys", str(folder), "--out", str(out / f"{name}.key"))
        assert made.returncode == 0, made.stderr
    with _with_settings(rig, "[api]\n", '[api]\ncurve = true\nkeys_dir = "keys"\n'):
        (folder / "server.key").chmod(0o644)
        rig.start_daemon(lambda process, _control: process.wait() and None)
        assert "open to others" in rig.daemon.last_words()
        assert "chmod 0600" in rig.daemon.last_words()
        (folder / "server.key").chmod(0o600)

        rig.start_daemon(_until_idle(out / "eye.key"))
        with Client(rig.control, timeout_s=1.0) as keyless, pytest.raises(NoAnswer):
            keyless.request("status")
        with Client(rig.control, keys=out / "eye.key") as eye, Client(rig.control, keys=out / "tester.key") as tester:
            before = rig.truth()["axes"]
            with pytest.raises(Refused, match="not_allowed"):
                eye.request("home", id="not-mine")
            with pytest.raises(Refused, match="not_allowed"):
                tester.request("home", id="not-mine-either")
            assert rig.truth()["axes"] == before
            assert eye.request("describe")["you"]["client"] == "eye"

            result = tester.job("look", job_id="once")
            with Client(rig.control, keys=out / "keeper.key") as keeper:
                assert keeper.job("look", job_id="once") == result, "a replayed id is answered, whoever asks, not done"
            assert eye.request("results", since=result.seq)["results"][0]["id"] == "once"
            with Subscription(rig.events, ("heartbeat",), keys=out / "eye.key") as heard:
                assert heard.next(10.0) is not None

            shown = _reprobe("status", "--endpoint", rig.control, "--key", str(out / "eye.key"), "--json")
            assert json.loads(shown.stdout)["state"] == "idle", shown.stderr
            revoked = _reprobe("keys", "revoke", "tester", "--config", str(out / "station.toml"), "--json")
            assert json.loads(revoked.stdout)["revoked"], revoked.stderr
            with pytest.raises(Refused, match="key_revoked"):
                tester.job("look")
        with Client(rig.control, keys=out / "tester.key") as tester, pytest.raises(NotLetIn):
            tester.request("status")
        refused = _reprobe("status", "--endpoint", rig.control, "--key", str(out / "tester.key"))
        assert refused.returncode == 1
        assert "does not take this key" in refused.stderr
