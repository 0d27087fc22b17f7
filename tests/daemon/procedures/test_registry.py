"""Each job's body is found by the name of its operation, and a missing, doubtful or other one is told at the start."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, Literal

import pytest

import daemon.procedures
from daemon.procedures.registry import PROCEDURES, find_procedures
from daemon.wire.operations.jobs import JobReply
from daemon.wire.operations.row import DefaultDeadline, Operation
from daemon.wire.operations.table import OPERATIONS
from daemon.wire.requests import JobRequest

IMPORT = f"from {__name__} import Brush, Wipe\n"
BODIES = f"{IMPORT}async def wipe(job, context, request: Wipe): return request.id\ndef polish(job, context): ...\n"
BRUSH = f"{IMPORT}async def brush(job, context, request: Brush): ...\n"


class Wipe(JobRequest):
    """A job that no station has yet."""

    op: Literal["wipe"]


class Brush(JobRequest):
    """Another one."""

    op: Literal["brush"]


class Polish(JobRequest):
    """One that nobody has written a body for."""

    op: Literal["polish"]


def _row(request: type[JobRequest]) -> Operation:
    return Operation(
        request=request, reply=JobReply, least_role="operate", deadline=DefaultDeadline.JOB, outcomes=("done",),
        example_reply={},
    )  # fmt: skip


def _job(request: JobRequest) -> Any:
    return SimpleNamespace(request=request)


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """A package of procedures on disk: `wipe` in a module, `brush` in a package inside, each once."""
    folder = tmp_path / "written_procedures"
    (folder / "inner").mkdir(parents=True)
    (folder / "__init__.py").write_text("")
    (folder / "inner" / "__init__.py").write_text("")
    (folder / "wiping.py").write_text(BODIES)
    (folder / "inner" / "brushing.py").write_text(f"from written_procedures.wiping import wipe\n{BRUSH}")
    monkeypatch.syspath_prepend(str(tmp_path))
    yield import_module("written_procedures")
    for name in [name for name in sys.modules if name.split(".")[0] == "written_procedures"]:
        del sys.modules[name]


def test_every_job_has_a_body_and_nothing_else_has() -> None:
    assert PROCEDURES.keys() == {row.op for row in OPERATIONS.rows if row.is_job}


async def test_a_new_body_is_found_where_it_is_defined_and_handed_its_request(package: ModuleType) -> None:
    found = find_procedures([_row(Wipe), _row(Brush)], package)
    nothing: Any = None
    assert found.keys() == {"wipe", "brush"}
    assert await found["wipe"](_job(Wipe(op="wipe", id="w")), nothing) == "w"
    with pytest.raises(TypeError, match="a request 'brush' is not for the procedure of Wipe"):
        await found["wipe"](_job(Brush(op="brush", id="b")), nothing)


def test_an_operation_without_a_body_that_can_be_awaited_is_refused(package: ModuleType) -> None:
    with pytest.raises(LookupError, match="'polish' has 0 procedures"):
        find_procedures([_row(Polish)], package)


def test_a_body_for_another_request_is_refused(package: ModuleType, tmp_path: Path) -> None:
    (tmp_path / "written_procedures" / "other.py").write_text(
        f"from {__name__} import Wipe\nasync def polish(job, context, request: Wipe): ...\n"
    )
    with pytest.raises(TypeError, match=r"the procedure polish takes .*Wipe.*, not Polish"):
        find_procedures([_row(Polish)], package)


def test_an_operation_with_two_bodies_is_refused(package: ModuleType, tmp_path: Path) -> None:
    (tmp_path / "written_procedures" / "other.py").write_text(BODIES)
    with pytest.raises(LookupError, match="'wipe' has 2 procedures"):
        find_procedures([_row(Wipe)], package)


def test_how_a_body_says_its_job_ended_is_in_the_row_of_an_operation() -> None:
    said = set()
    for path in Path(daemon.procedures.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Outcome":
                said |= {arg.value for arg in node.args[:1] if isinstance(arg, ast.Constant)}
    assert "placed" in said
    assert said <= set(OPERATIONS.outcomes)
