"""A job's result tells what was asked for, also where it failed."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from daemon.cli.formatting import sentence
from daemon.domain.errors import Fault, FaultCode
from daemon.jobs.context import Outcome
from daemon.jobs.ended import EndedJob
from daemon.wire.operations.jobs import Calibrate, Home


def _ended(request: Any, outcome: Outcome, fault: Fault | None) -> EndedJob:
    return EndedJob(request, cast("Any", SimpleNamespace(looks=0, moves=0)), outcome, fault, "t", {}, None)


@pytest.mark.parametrize("fault", [None, Fault(FaultCode.CAMERA_FAILED)])
def test_a_calibration_says_which_it_is_whether_or_not_it_failed(fault: Fault | None) -> None:
    request = Calibrate(op="calibrate", id="c", what="surface")
    result = _ended(request, Outcome("calibrated"), fault).result("s", 1)
    assert result.detail["what"] == "surface"
    assert ("calibrate surface failed" if fault else "surface calibrated") in sentence(result)


def test_an_operation_of_one_kind_has_no_such_word() -> None:
    assert _ended(Home(op="home", id="h"), Outcome("homed"), None).result("s", 1).detail == {}
