"""Table of procedures: the body of each job, found by the name of its operation.

The body of an operation is the one coroutine function of its name in the modules of this package. So a job needs its
row (`daemon.wire.operations.jobs`) and its body, and nobody lists it a second time.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from importlib import import_module
from inspect import iscoroutinefunction, signature
from pkgutil import walk_packages
from types import ModuleType
from typing import Any

import daemon.procedures
from daemon.jobs.context import JobContext, Outcome, Procedure, ProcedureFor, StationContext
from daemon.wire.operations.row import Operation
from daemon.wire.operations.table import OPERATIONS
from daemon.wire.requests import Request


def procedure(kind: type[Request], body: ProcedureFor[Any]) -> Procedure:
    """Return `body` as a procedure of any job, which hands it the job's request; TypeError for another kind of request.

    TypeError also, and at once, for a body whose last parameter is not annotated with `kind`.
    """
    *_, last = signature(body, eval_str=True).parameters.values()
    if last.annotation is not kind:
        raise TypeError(f"the procedure {body.__name__} takes {last.annotation}, not {kind.__name__}")

    async def run(job: JobContext, context: StationContext) -> Outcome:
        if not isinstance(job.request, kind):
            raise TypeError(f"a request {job.request.op!r} is not for the procedure of {kind.__name__}")
        return await body(job, context, job.request)

    return run


def find_procedures(rows: Iterable[Operation], package: ModuleType) -> dict[str, Procedure]:
    """Return operation -> procedure; raise LookupError for an operation that has none, or more than one."""
    modules = list(_modules(package))
    return {row.op: procedure(row.request, _body(row.op, modules)) for row in rows}


def _body(op: str, modules: Iterable[ModuleType]) -> ProcedureFor[Any]:
    found: list[ProcedureFor[Any]] = [vars(module)[op] for module in modules if _defines(module, op)]
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


PROCEDURES: Mapping[str, Procedure] = find_procedures((row for row in OPERATIONS.rows if row.is_job), daemon.procedures)
