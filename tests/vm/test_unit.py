"""The installed package as the real unit on real device nodes, with the simulated station behind them."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from daemon.client import Client
from daemon.tools.demo.session import Session
from tests.vm.station import CAMERA, LINE, OTHER_CAMERA, OTHER_LINE, Station, until_open

pytestmark = pytest.mark.timeout(1800)
OPENS = ("dd", "of=/dev/null", "iflag=nonblock,noctty", "count=0", "status=none")


@pytest.fixture(scope="module")
def running(stand: Station) -> Station:
    """The station with its daemon up."""
    until_open(stand)
    return stand


@pytest.fixture(scope="module")
def client(running: Station) -> Iterator[Client]:
    """A tester elsewhere, with a key."""
    with running.client() as connected:
        yield connected


@pytest.fixture(scope="module")
def session(running: Station, client: Client) -> Session:
    """The same, after it homed, taught and calibrated the station through the emulated machine."""
    ready = Session(client, running.bench, running.board, 11, lambda _text: None)
    ready.set_up()
    return ready


def _recover(client: Client) -> None:
    """Leave the fault, as a person does who mended its cause."""
    reply = client.raw(b'{"op": "reset"}', timeout_s=300.0)
    if not reply["ok"]:
        assert reply["error"]["name"] == "not_homed", reply["error"]
        assert client.job("home", timeout_s=300.0).ok


def _place(station: Station) -> tuple[float, float, float]:
    """Return where the head really is, but for its height."""
    axes = station.bench.ask("truth")["axes"]
    return axes["x_um"], axes["y_um"], axes["theta_deg"]


def test_ready_means_that_line_and_camera_are_open(running: Station) -> None:
    vm = running.vm
    assert vm.show("ActiveState") == "active"
    # What a running daemon closes between the listing and the reading is not held.
    held = vm.run("sh", "-c", f"readlink /proc/{vm.main_pid()}/fd/* || :").split()
    assert {LINE, CAMERA} <= set(held)
    drives = running.bench.ask("status")["statistics"]
    assert drives["requests"] > 0, "the drives behind the serial port were asked"


def test_the_device_rules_give_their_names_to_the_daemons_group(running: Station) -> None:
    for name, node in (("bus", LINE), ("camera", CAMERA)):
        assert running.vm.run("readlink", "-f", f"/dev/reprobe-{name}").strip() == node
        assert running.vm.run("stat", "-c", "%G %a", node).strip() == "reprobe 660"


@pytest.mark.parametrize(("own", "other"), [(LINE, OTHER_LINE), (CAMERA, OTHER_CAMERA)])
def test_its_own_device_is_open_to_it_and_the_next_one_is_not(running: Station, own: str, other: str) -> None:
    vm = running.vm
    for node in (own, other):
        vm.run(*OPENS, f"if={node}")  # outside of the unit both open: what refuses below is the unit's list
    assert vm.in_group_of("reprobe.service", *OPENS, f"if={own}")
    assert not vm.in_group_of("reprobe.service", *OPENS, f"if={other}")


@pytest.mark.parametrize("name", ["TP4", "TP6", "TP8", "TP12"])
def test_a_correction_lands(running: Station, session: Session, name: str) -> None:
    landing = session.land(running.board.point(name))
    print(f"{name}: {landing.before_um:.1f} -> {landing.after_um:.1f} um, {landing.result.looks} looks")  # noqa: T201  # a figure for whoever looks
    assert landing.result.ok, landing.result.error
    assert landing.after_um <= 50.0
    assert landing.result.test_point == name
    running.vm.until_status(f"last: correct {name}")


def test_pictures_that_stop_are_told_and_a_camera_that_is_back_is_used(
    running: Station, client: Client, session: Session
) -> None:
    assert client.job("place", test_point="TP1", theta_deg=10.0).ok
    running.vm.run("systemctl", "stop", "camera-feed")
    without = client.job("correct", test_point="TP1", timeout_s=300.0)
    assert without.error is not None
    assert without.error.name == "camera_failed", without.error
    running.vm.run("systemctl", "start", "camera-feed", within_s=300.0)
    _recover(client)
    assert session.land(running.board.point("TP1")).good


def test_a_line_that_is_cut_is_told_and_used_again_when_it_is_mended(
    running: Station, client: Client, session: Session
) -> None:
    running.bench.ask("fault", name="cable_out", on=True)
    try:
        without = client.job("place", test_point="TP3", theta_deg=30.0, timeout_s=300.0)
    finally:
        running.bench.ask("fault", name="cable_out", on=False)
    assert without.error is not None
    assert without.error.name == "link_lost", without.error
    _recover(client)
    assert session.land(running.board.point("TP3")).good


def test_a_device_that_is_plugged_in_again_starts_the_daemon_anew_and_moves_nothing(
    running: Station, client: Client, session: Session
) -> None:
    """Its list of allowed devices is drawn up at its start. The old one lifts the needle as it goes, no more."""
    before, hung_up = _place(running), running.vm.main_pid()
    running.vm.run("udevadm", "trigger", "--action=add", f"--name-match={CAMERA}")
    running.vm.until(lambda: running.vm.main_pid() not in (0, hung_up), "it was not started anew")
    until_open(running)
    assert _place(running) == before
    assert session.land(running.board.point("TP5")).good, "the drives kept their reference, the folder its calibration"


def test_a_stop_darkens_and_leaves_with_success(running: Station, session: Session) -> None:
    running.vm.run("systemctl", "stop", "reprobe", within_s=300.0)
    assert running.vm.show("Result") == "success"
    truth = running.bench.ask("truth")
    assert not truth["moving"]
    assert max(truth["white"], truth["red"]) < 0.05
