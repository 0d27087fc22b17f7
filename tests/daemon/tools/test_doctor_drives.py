"""The examination of lines and drives, on far ends that send raw bytes."""

from __future__ import annotations

import dataclasses
from collections.abc import AsyncIterator, Callable
from pathlib import Path

import pytest

from daemon.config.sections.devices import BusSection
from daemon.tools.doctor.drives import examine_axis, examine_round_trip
from daemon.tools.doctor.findings import CheckResults
from daemon.tools.doctor.scan import scan_line
from daemon.tools.setup import who_answers
from drivers.bus import ModbusBus, SerialLine
from drivers.errors import LinkTimeout
from drivers.l4118 import Axis
from tests.drivers.l4118.conftest import CONFIG
from tests.drivers.peers.drive import DriveModel, several
from tests.drivers.peers.line import Answer, PtyLine, Step, framed

Open = Callable[[Answer], "Ends"]
MOVES = {6, 15, 16, 23}


class Ends:
    """A line with its far end."""

    def __init__(self, path: Path, answer: Answer) -> None:
        self.far = PtyLine(path, answer)
        self.near = SerialLine(str(path), 115200, "N", 1)

    async def examine(self, *, round_trip: bool = False) -> dict[str, tuple[str, str]]:
        """Examine slave 3 and return verdict and text of each check."""
        bus = await ModbusBus.open(self.near, timeout_s=0.2, late_reply_s=0.2, attempts=3)
        findings, axis = CheckResults(), Axis(bus, CONFIG)
        await examine_axis(findings, axis, bus)
        if round_trip:
            await examine_round_trip(findings, axis, bus)
        await bus.close()
        return {check.about: (check.verdict, f"{check.found}; {check.advice}") for check in findings.checks}


@pytest.fixture
async def ends(tmp_path: Path) -> AsyncIterator[Open]:
    made: list[Ends] = []

    def make(answer: Answer) -> Ends:
        made.append(Ends(tmp_path / f"line{len(made)}", answer))
        return made[-1]

    yield make
    for one in made:
        one.far.close()


async def test_a_sound_drive_is_good_and_its_settings_are_shown_as_they_are(ends: Open) -> None:
    drive = DriveModel(3)
    drive.od |= {(0x2030, 0): [4, 50], (0x2031, 0): [4, 1800], (0x605A, 0): [2, 2], (0x605E, 0): [2, 0xFFFF]}
    told = await ends(drive.answer).examine()
    assert {verdict for verdict, _ in told.values()} == {"ok"}
    shown = told["axis Z settings"][1]
    for setting in (
        "2030h:00 = 50",
        "2031h:00 = 1800",
        "605Ah:00 = 2",
        "605Bh:00 = none",
        "605Eh:00 = -1",
        "3240h:01 = 7",
    ):
        assert setting in shown
    assert drive.log == []


@pytest.mark.parametrize(("inputs", "verdict"), [(0, "fail"), (0b001, "warn"), (0b011, "ok"), (0b110, "fail")])
async def test_limit_inputs_that_are_off_are_told(ends: Open, inputs: int, verdict: str) -> None:
    drive = DriveModel(3)
    drive.od[0x3240, 1][1] = inputs
    told = await ends(drive.answer).examine()
    assert told["axis Z switches"][0] == verdict
    assert f"3240h:01 = {inputs:X}h" in told["axis Z switches"][1]


async def test_a_drive_without_function_43_is_named_as_that(ends: Open) -> None:
    drive = DriveModel(3)

    def answer(request: bytes) -> list[Step]:
        return [framed(bytes([3, 0xAB, 1]))] if request[1] == 43 else list(drive.answer(request))

    verdict, text = (await ends(answer).examine())["axis Z"]
    assert verdict == "fail"
    assert "exception 01h to FC 43" in text


async def test_an_adapter_that_hears_itself_is_named(ends: Open) -> None:
    drive = DriveModel(3)
    verdict, text = (await ends(lambda request: [request, *drive.answer(request)]).examine())["axis Z"]
    assert verdict == "fail"
    assert "hears itself" in text


async def test_two_slaves_with_one_address_are_suspected_by_their_garbled_answers(ends: Open) -> None:
    drive = DriveModel(3)
    asked = 0

    def answer(request: bytes) -> list[Step]:
        nonlocal asked
        asked += 1
        if asked % 5:
            return list(drive.answer(request))
        return [bytes(byte & 0x5A for step in drive.answer(request) if isinstance(step, bytes) for byte in step)]

    verdict, text = (await ends(answer).examine())["axis Z address"]
    assert verdict == "warn"
    assert "two slaves have address 3" in text


@pytest.mark.parametrize(("late_s", "verdict"), [(0.0, "ok"), (0.03, "warn")])
async def test_a_slow_adapter_is_told_from_a_quick_one(ends: Open, late_s: float, verdict: str) -> None:
    drive = DriveModel(3)

    def answer(request: bytes) -> list[Step]:
        return [late_s, *drive.answer(request)] if late_s else list(drive.answer(request))

    told = await ends(answer).examine(round_trip=True)
    assert told["round trip of axis Z"][0] == verdict
    assert ("latency" in told["round trip of axis Z"][1]) == (verdict == "warn")


async def test_a_scan_finds_who_answers_and_writes_nothing(ends: Open) -> None:
    drives = [DriveModel(2), DriveModel(7)]
    both = several(*drives)

    def answer(request: bytes) -> list[Step]:
        relay = [framed(bytes([5, request[1] | 0x80, 1]))]
        return relay if request[0] == 5 else list(both(request))

    line = ends(answer)
    findings = CheckResults()
    found = await scan_line(findings, "bus main", dataclasses.replace(line.near), range(1, 9))
    assert found == [2, 5, 7], "a relay board without such registers refuses: that is an answer"
    assert [check.verdict for check in findings.checks] == ["ok"] * 3
    assert not any(request[1] in MOVES or request[1] == 43 for request in line.far.requests)
    assert all(drive.log == [] for drive in drives)


async def test_a_drive_that_is_late_once_is_not_missed_by_who_sets_up_a_station(ends: Open) -> None:
    """A computer or a slave may be busy just when its address is asked: the silent ones are asked again."""
    both = several(DriveModel(2), DriveModel(7))
    late = {2: [0.0, 0.5]}

    def answer(request: bytes) -> list[Step]:
        if request[0] == 5:
            return [framed(bytes([5, request[1] | 0x80, 1]))]
        wait_s = (late.get(request[0]) or [0.0]).pop(0) if late.get(request[0]) else 0.0
        return [wait_s, *both(request)] if wait_s else list(both(request))

    line = ends(answer)
    found = await who_answers(BusSection(port=line.near.port, parity="N"), range(1, 9))
    assert found is not None
    assert (found.drives, found.others) == ((2, 7), (5,))


async def test_one_that_falls_silent_is_not_taken_for_a_relay_board(ends: Open) -> None:
    both, asked = several(DriveModel(2), DriveModel(7)), 0

    def answer(request: bytes) -> list[Step]:
        nonlocal asked
        asked += request[0] == 7
        return [] if request[0] == 7 and asked > 2 else list(both(request))

    line = ends(answer)
    with pytest.raises(LinkTimeout):
        await who_answers(BusSection(port=line.near.port, parity="N"), range(1, 9))
