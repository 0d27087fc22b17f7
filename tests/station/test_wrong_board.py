"""Boards that are not where or what they should be, on the simulated station: no wrong pad, and the reason by name.

Judged by the truth under the needle, not by the daemon's word.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from daemon.client import Client
from daemon.domain.results import JobResult
from tests.station.rig import Rig, running_rig

PAD, NEXT = "U1.3", "U1.4"


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    folder: Path = tmp_path_factory.mktemp("wrong-board")
    with running_rig(folder, seed=7) as running, running.client() as client:
        running.session(client).set_up()
        yield running


@pytest.fixture
def client(rig: Rig) -> Iterator[Client]:
    with rig.client() as one:
        yield one


def _tried(client: Client, name: str = PAD) -> JobResult:
    placed = client.job("place", test_point=name, theta_deg=20.0)
    return placed if placed.error is not None else client.job("correct", test_point=name)


def _over(rig: Rig) -> str | None:
    on = rig.truth()["on"]
    return str(on["pin"]) if on["what"] == "metal" else None


def test_a_pad_of_a_part_is_landed_on(rig: Rig, client: Client) -> None:
    result = _tried(client)
    assert result.ok, result.error
    assert result.detail["decided_by"] == "registered"
    assert _over(rig) == PAD


def test_a_board_displaced_by_one_pitch_is_not_taken_for_itself(rig: Rig, client: Client) -> None:
    """The next pin lies exactly where this one should be."""
    one, other = rig.board.point(PAD), rig.board.point(NEXT)
    with rig.fault("board_displaced", dx_um=one.x_um - other.x_um, dy_um=one.y_um - other.y_um):
        result = _tried(client)
        assert not result.ok or _over(rig) == PAD
        assert result.error is not None
        assert result.error.name == "wrong_place"
        assert result.error.detail["off_um"] == pytest.approx([one.x_um - other.x_um, one.y_um - other.y_um], abs=150.0)


def test_the_seat_is_verified_and_an_axis_that_stalls_is_noticed_at_its_place(rig: Rig, client: Client) -> None:
    aligned = client.job("align", timeout_s=300.0)
    assert aligned.ok, aligned.error
    assert aligned.detail["seat"]["verified"] is True
    client.job("place", test_point="U1.16", theta_deg=20.0)
    with rig.fault("stall", axis="x", detected=False):
        placed = client.job("place", test_point=PAD, theta_deg=20.0)
    assert placed.error is not None
    assert placed.error.name == "wrong_place"
    again = client.job("correct", test_point=PAD)
    assert again.error is not None
    assert again.error.name == "not_aligned"
    assert client.job("home").ok
    assert client.job("align", timeout_s=300.0).ok
    assert _tried(client).ok
    assert _over(rig) == PAD


@pytest.mark.parametrize(("fault", "name"), [("board_turned", "board_turned"), ("board_gone", "no_board")])
def test_what_lies_there_instead_is_named_and_voids_the_seat(rig: Rig, client: Client, fault: str, name: str) -> None:
    with rig.fault(fault):
        result = _tried(client)
        assert result.error is not None
        assert result.error.name == name
        align = client.job("align", timeout_s=300.0)
        assert align.error is not None
        assert align.error.name == name
    assert client.job("align", timeout_s=300.0).ok


def test_a_failed_look_keeps_cad_over_its_picture(rig: Rig, client: Client) -> None:
    with rig.fault("board_displaced", dx_um=2000.0, dy_um=0.0):
        result = client.job("place", test_point=PAD, theta_deg=20.0)
    assert result.pictures is not None
    client.job("look")  # the next job begins only when the pictures are written
    assert (Path(result.pictures) / "before-board.jpg").is_file()
    assert client.job("align", timeout_s=300.0).ok
