"""Table of operations: all rows, and what follows from them: names, validation of requests, and who may ask what."""

from __future__ import annotations

import reprlib
from collections.abc import Iterable
from functools import reduce
from operator import or_
from typing import Annotated, Any, Final

from pydantic import Field, TypeAdapter, ValidationError

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.roles import ROLES, Caller, Role
from daemon.wire.limits import MAX_FIELDS, MAX_LISTED
from daemon.wire.operations import control, describe, health, jobs, records, runs
from daemon.wire.operations.row import Operation
from daemon.wire.requests import VERSIONS, WIRE_VERSION

MAX_NAME, MAX_PROBLEM = 64, 200
"""Letters of a field's name, and of what is wrong with it, that a refusal repeats."""
AnyRequest = (
    jobs.AnyJob
    | runs.AnyRunQuestion
    | control.AnyControl
    | health.AnyHealth
    | describe.AnyDescription
    | records.AnyRecord
)
"""Every request, for the type checker. A test holds it together with the rows."""


class OperationTable:
    """Rows by the names of their operations; raise ValueError for two of one name."""

    def __init__(self, rows: Iterable[Operation]) -> None:
        self.rows = tuple(rows)
        self._by_op = {row.op: row for row in self.rows}
        if len(self._by_op) != len(self.rows):
            raise ValueError(f"two operations of one name: {[row.op for row in self.rows]}")
        models: Any = reduce(or_, (row.request for row in self.rows))
        self.requests: TypeAdapter[AnyRequest] = TypeAdapter(Annotated[models, Field(discriminator="op")])
        """Validation of any request, by its `op`."""

    @property
    def ops(self) -> tuple[str, ...]:
        """Names of all operations."""
        return tuple(self._by_op)

    @property
    def outcomes(self) -> tuple[str, ...]:
        """How jobs can end well."""
        return tuple(outcome for row in self.rows for outcome in row.outcomes)

    def row(self, op: object) -> Operation:
        """Return the row of an operation; raise `Fault` if there is none of that name."""
        row = self._by_op.get(op) if isinstance(op, str) else None
        if row is None:
            raise Fault(FaultCode.UNKNOWN_OP, f"there is no operation {_short(op)}", ops=list(self.ops))
        return row

    def operation(self, raw: Any) -> Operation:
        """Return the row a decoded JSON value asks for; raise `Fault` if it asks for none. Looks at no other field."""
        if not isinstance(raw, dict):
            raise Fault(FaultCode.BAD_JSON, "the message is not a JSON object", got=type(raw).__name__)
        version = raw.get("v", WIRE_VERSION)
        if type(version) is not int or version not in VERSIONS:
            raise Fault(
                FaultCode.UNSUPPORTED_VERSION, f"version {_short(version)} is not spoken here", supported=VERSIONS
            )
        return self.row(raw.get("op"))

    def parse(self, raw: Any) -> AnyRequest:
        """Validate a decoded JSON value; raise `Fault` with bad fields named, the first `MAX_LISTED` of them."""
        self.operation(raw)
        if len(raw) > MAX_FIELDS:
            raise Fault(
                FaultCode.INVALID_REQUEST, f"{len(raw)} fields, and no operation has more than {MAX_FIELDS}", fields=[]
            )
        try:
            return self.requests.validate_python(raw)
        except ValidationError as exc:
            fields, count = _fields(exc), exc.error_count()
            more: dict[str, Any] = {"more": count - len(fields)} if count > len(fields) else {}
            raise Fault(FaultCode.INVALID_REQUEST, fields=fields, **more) from exc

    def may(self, role: Role, op: str) -> bool:
        """Whether a role may ask for an operation."""
        return ROLES.index(role) >= ROLES.index(self.row(op).least_role)

    def require(self, caller: Caller, op: str) -> None:
        """Raise `Fault` if the caller may not ask for `op`."""
        if not self.may(caller.role, op):
            needs = self.row(op).least_role
            raise Fault(FaultCode.NOT_ALLOWED, f"{op} needs the role {needs}, this key has {caller.role}", needs=needs,
                        role=caller.role)  # fmt: skip


def _fields(error: ValidationError) -> list[dict[str, str]]:
    """List bad fields with their trouble; the op that discriminates the union is no part of the path."""
    errors = error.errors(include_url=False, include_context=False, include_input=False)
    return [
        {"field": ".".join(str(p)[:MAX_NAME] for p in e["loc"][1:]) or "(message)", "problem": e["msg"][:MAX_PROBLEM]}
        for e in errors[:MAX_LISTED]
    ]


def _short(value: Any) -> str:
    """Return a decoded JSON value as it looks, cut short before it is written out."""
    return reprlib.repr(value)[:100]


OPERATIONS: Final = OperationTable((*jobs.ROWS, *runs.ROWS, *control.ROWS, *health.ROWS, *describe.ROWS, *records.ROWS))
"""All operations, in the order of the page."""
