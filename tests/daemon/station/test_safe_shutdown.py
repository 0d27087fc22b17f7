"""The needle is lifted when the daemon ends, unless the axes may not stand where their drives believe."""

from __future__ import annotations

from typing import Any, cast

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.station.safe_shutdown import UNSURE, raise_needle, shut_down
from drivers.errors import LinkTimeout, Stalled


class Machine:
    """Hardware and station in one, as far as leaving reaches them."""

    def __init__(self, *, homed: bool = True, silent: bool = False, stuck: bool = False) -> None:
        self.did: list[str] = []
        self._homed, self._silent, self._stuck = homed, silent, stuck

    async def homed(self, _deadline: object) -> bool:
        if self._silent:
            raise LinkTimeout("no answer", device="z")
        return self._homed

    async def retract(self, _deadline: object) -> None:
        self.did.append("lifted")
        if self._stuck:
            raise Stalled("blocked", device="z")

    async def close(self, _deadline: object) -> None:
        self.did.append("closed")


async def _left(machine: Machine, fault: Fault | None) -> list[str]:
    anything = cast("Any", machine)
    await shut_down(anything, anything, fault)
    return machine.did


@pytest.mark.parametrize("kind", [None, FaultCode.CAMERA_FAILED, FaultCode.LIGHT_FAILED, FaultCode.JOURNAL_FAILED])
async def test_the_needle_is_lifted_before_the_devices_are_let_go(kind: FaultCode | None) -> None:
    assert await _left(Machine(), Fault(kind) if kind else None) == ["lifted", "closed"]


MOTION, BUS, SAFETY = 32, 41, 51
"""Hundreds of the codes of these faults."""


@pytest.mark.parametrize("kind", [k for k in FaultCode if k.latched and k.code // 100 in (MOTION, BUS, SAFETY)])
async def test_in_a_fault_of_motion_or_bus_nothing_moves_by_itself(kind: FaultCode) -> None:
    assert await _left(Machine(), Fault(kind)) == ["closed"]


async def test_devices_are_let_go_where_there_is_no_station_yet() -> None:
    machine = Machine()
    await shut_down(cast("Any", machine), None, None)
    assert machine.did == ["closed"]


async def test_axes_without_a_reference_are_not_moved() -> None:
    assert await _left(Machine(homed=False), None) == ["closed"]


@pytest.mark.parametrize("trouble", ["silent", "stuck"])
async def test_drives_that_do_not_answer_or_do_not_move_are_let_go_all_the_same(trouble: str) -> None:
    machine = Machine(silent=trouble == "silent", stuck=trouble == "stuck")
    kept = await raise_needle(cast("Any", machine))
    assert kept is not None
    assert kept.kind is (FaultCode.LINK_LOST if trouble == "silent" else FaultCode.AXIS_STALLED)
    assert (await _left(machine, None))[-1] == "closed"


def test_every_fault_that_needs_homing_is_among_those_in_which_nothing_moves() -> None:
    told_to_home = {kind for kind in FaultCode if kind.latched and "home" in kind.value.advice}
    assert told_to_home <= UNSURE
