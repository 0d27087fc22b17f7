"""Table of procedures: the body of each job, found by the name of its operation.

The body of an operation is the one coroutine function of its name in the modules of this package. So a job needs its
row (`daemon.wire.operations.jobs`) and its body, and nobody lists it a second time.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from importlib import import_module
from inspect import iscoroutinefunction
from pkgutil import walk_packages
from types import ModuleType

import daemon.procedures
from daemon.jobs.context import Procedure
from daemon.wire.operations.table import OPERATIONS


def find_procedures(ops: Iterable[str], package: ModuleType) -> dict[str, Procedure]:
    """Return operation -> procedure; raise LookupError for an operation that has none, or more than one."""
    modules = list(_modules(package))
    return {op: _procedure(op, modules) for op in ops}


def _procedure(op: str, modules: Iterable[ModuleType]) -> Procedure:
    found: list[Procedure] = [vars(module)[op] for module in modules if _defines(module, op)]
    if len(found) != 1:
        raise LookupError(f"operation {op!r} has {len(found)} procedures: one `async def {op}` is needed")
    return found[0]


def _defines(module: ModuleType, name: str) -> bool:
    """Whether a module defines a coroutine function itself; an imported one is defined elsewhere."""
    value = vars(module).get(name)
    return iscoroutinefunction(value) and value.__module__ == module.__name__


def _modules(package: ModuleType) -> Iterator[ModuleType]:
    for info in walk_packages(package.__path__, f"{package.__name__}."):
        yield import_module(info.name)


PROCEDURES: Mapping[str, Procedure] = find_procedures(
    (row.op for row in OPERATIONS.rows if row.is_job), daemon.procedures
)
