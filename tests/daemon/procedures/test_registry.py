"""Each job's body is found by the name of its operation, and a missing or doubtful one is told at the start."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest

import daemon.procedures
from daemon.procedures.align import align
from daemon.procedures.calibrate.dispatch import calibrate
from daemon.procedures.registry import PROCEDURES, find_procedures
from daemon.wire.operations.table import OPERATIONS


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """A package of procedures on disk: `wipe` in a module, `brush` in a package inside, each once."""
    folder = tmp_path / "written_procedures"
    (folder / "inner").mkdir(parents=True)
    (folder / "__init__.py").write_text("")
    (folder / "inner" / "__init__.py").write_text("")
    (folder / "wiping.py").write_text("async def wipe(job, context): ...\ndef sync(job, context): ...\n")
    (folder / "inner" / "brushing.py").write_text(
        "from written_procedures.wiping import wipe\nasync def brush(job, context): ...\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    yield import_module("written_procedures")
    for name in [name for name in sys.modules if name.split(".")[0] == "written_procedures"]:
        del sys.modules[name]


def test_every_job_has_a_body_and_nothing_else_has() -> None:
    assert PROCEDURES.keys() == {row.op for row in OPERATIONS.rows if row.is_job}


def test_bodies_are_found_in_modules_and_in_packages() -> None:
    assert find_procedures(["align", "calibrate"], daemon.procedures) == {"align": align, "calibrate": calibrate}


def test_a_new_body_is_found_where_it_is_defined(package: ModuleType) -> None:
    found = find_procedures(["wipe", "brush"], package)
    assert {op: body.__module__ for op, body in found.items()} == {
        "wipe": "written_procedures.wiping", "brush": "written_procedures.inner.brushing",
    }  # fmt: skip


@pytest.mark.parametrize("op", ["polish", "sync"])
def test_an_operation_without_a_body_is_refused(package: ModuleType, op: str) -> None:
    with pytest.raises(LookupError, match=f"'{op}' has 0 procedures"):
        find_procedures([op], package)


def test_an_operation_with_two_bodies_is_refused(package: ModuleType, tmp_path: Path) -> None:
    (tmp_path / "written_procedures" / "other.py").write_text("async def wipe(job, context): ...\n")
    with pytest.raises(LookupError, match="'wipe' has 2 procedures"):
        find_procedures(["wipe"], package)


def test_how_a_body_says_its_job_ended_is_in_the_row_of_an_operation() -> None:
    said = set()
    for path in Path(daemon.procedures.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Outcome":
                said |= {arg.value for arg in node.args[:1] if isinstance(arg, ast.Constant)}
    assert "placed" in said
    assert said <= set(OPERATIONS.outcomes)
