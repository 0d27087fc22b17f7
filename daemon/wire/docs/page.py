"""Page `wire.md`: operations, events, errors, roles and limits, as tables made from rows and models."""

from __future__ import annotations

import inspect
import json
from collections.abc import Iterable
from typing import Any, Final

from pydantic import BaseModel

from daemon.domain.errors import FaultCode
from daemon.domain.roles import ROLES
from daemon.wire.docs import examples as wire_examples
from daemon.wire.docs import text as wire_words
from daemon.wire.docs.models import model_schema
from daemon.wire.events import TOPICS, EventMessage
from daemon.wire.limits import EVENT_QUEUE, HARD_LIMIT, MAX_HELD, MAX_PENDING
from daemon.wire.operations.row import Operation
from daemon.wire.operations.table import OPERATIONS, OperationTable
from daemon.wire.replies import AnyReply, Refusal, Reply
from daemon.wire.requests import VERSIONS, Request

LIMITS: Final = ("max_message_bytes", "rate_per_s", "rate_burst", "queue_length", "queue_per_client", "heartbeat_s")


def page(api: type[BaseModel], operations: OperationTable = OPERATIONS) -> str:
    """Return the whole page; `api` is the section of the configuration whose defaults it tells."""
    parts = [
        wire_words.INTRO, wire_words.VERSIONS, f"Versions spoken: {', '.join(map(str, VERSIONS))}.\n",
        _envelopes(operations), _jobs(operations), wire_words.ASKING,
        wire_words.LATE, wire_words.KEYS, _roles(operations), _limits(api),
        "## Operations\n", *(_operation(row, operations) for row in operations.rows),
        "## Events\n", *(_event(topic, model, operations) for topic, model in TOPICS.items()),
        _inner(operations), _errors(),
    ]  # fmt: skip
    return "\n".join(parts)


def _envelopes(operations: OperationTable) -> str:
    refusal = Refusal.model_validate(wire_examples.REFUSAL)
    return "\n".join(
        (
            "## What every message carries\n", "Every request:\n", _fields(Request, operations),
            "Every reply; `ok` tells a good one from a refusal, which carries `error` instead of the rest:\n",
            _fields(Reply, operations),
            "Every event:\n", _fields(EventMessage, operations), "A refusal:\n", _json(json.loads(refusal.to_json())),
        )
    )  # fmt: skip


def _jobs(operations: OperationTable) -> str:
    *names, last = (f"`{row.op}`" for row in operations.rows if row.is_job)
    return wire_words.JOBS.format(jobs=f"{', '.join(names)} and {last}")


def _roles(operations: OperationTable) -> str:
    rows = [(role, ", ".join(f"`{row.op}`" for row in operations.rows if row.least_role == role)) for role in ROLES]
    said = [f"| {role} | {'all of the above and ' if n else ''}{ops} |" for n, (role, ops) in enumerate(rows)]
    return _table(("role", "may ask")) + "\n".join(said) + "\n\nAll roles hear the events.\n"


def _limits(api: type[BaseModel]) -> str:
    fields = api.model_fields
    rows = [(f"`api.{name}`", str(fields[name].default), fields[name].description or "") for name in LIMITS]
    rows += [
        ("", str(HARD_LIMIT), "bytes beyond which a connection is cut without an answer"),
        ("", str(MAX_HELD), "replies held at once for one client that waits"),
        ("", str(MAX_PENDING), "the same for all"),
        ("", str(EVENT_QUEUE), "events held for a slow subscriber"),
    ]
    body = "\n".join(f"| {' | '.join(row)} |" for row in rows)
    return f"## Limits\n\n{_table(('setting', 'default', 'what'))}{body}\n"


def _operation(row: Operation, operations: OperationTable) -> str:
    answer = row.reply.model_validate(wire_examples.reply(row))
    return "\n".join(
        (
            f"### {row.op}\n", f"{_plain(row.sentence)} Role: {row.least_role}.\n",
            _fields(row.request, operations, beyond=Request), _json(wire_examples.request(row)),
            f"Reply: {_doc(row.reply)}\n", _fields(row.reply, operations, beyond=Reply),
            _json(json.loads(answer.to_json())),
        )
    )  # fmt: skip


def _event(topic: str, model: type[EventMessage], operations: OperationTable) -> str:
    example = model.model_validate(wire_examples.event(topic))
    return "\n".join(
        (
            f"### {topic}\n",
            f"{_doc(model)}\n",
            _fields(model, operations, beyond=EventMessage),
            _json(example.model_dump(mode="json")),
        )
    )


def _inner(operations: OperationTable) -> str:
    """Return the models that stand inside of others."""
    found: dict[str, dict[str, Any]] = {}
    models: tuple[type[BaseModel], ...] = (*(row.reply for row in operations.rows), *TOPICS.values(), Refusal)
    for model in models:
        found |= model_schema(model, operations, "serialization").get("$defs", {})
    for row in operations.rows:
        found = model_schema(row.request, operations, "validation").get("$defs", {}) | found
    parts = ["## Parts\n"]
    for name, schema in sorted(found.items()):
        parts += [f"### {name}\n", f"{_plain(schema.get('description', ''))}\n", _rows(schema, set())]
    return "\n".join(parts)


def _errors() -> str:
    rows = [
        f"| {k.code} | `{k.wire_name}` | {k.value.cause} | {k.value.advice} | {'yes' if k.latched else ''} |"
        for k in sorted(FaultCode, key=lambda k: k.code)
    ]
    head = (
        "## Errors\n\n1xxx the request, 2xxx seeing, 3xxx motion, 4xxx link, light and camera, 5xxx safety, "
        "6xxx contact, 9xxx the daemon itself. A latched one keeps the daemon in `fault` until a person acts.\n\n"
    )
    return head + _table(("code", "name", "cause", "cure", "latched")) + "\n".join(rows) + "\n"


def _doc(model: type[BaseModel]) -> str:
    return _plain(inspect.getdoc(model) or "")


def _plain(text: str) -> str:
    return " ".join(text.split())


def _fields(model: type[BaseModel], operations: OperationTable, beyond: type[BaseModel] | None = None) -> str:
    """Return a model's fields as a table, leaving out those of the base it shares with others."""
    shared = set(beyond.model_fields) if beyond is not None else set()
    sent = issubclass(model, AnyReply | EventMessage)
    schema = model_schema(model, operations, "serialization" if sent else "validation")
    return _rows(schema, (shared - {"id"}) | {"op"})


def _rows(schema: dict[str, Any], leave_out: Iterable[str]) -> str:
    properties = {name: facts for name, facts in schema.get("properties", {}).items() if name not in set(leave_out)}
    if not properties:
        return "No fields of its own.\n"
    required = set(schema.get("required", ()))
    rows = [
        f"| `{name}` | {_type(facts)} | {_default(name, facts, required)} | {facts.get('description', '')} |"
        for name, facts in properties.items()
    ]
    return _table(("field", "type", "default", "meaning")) + "\n".join(rows) + "\n"


def _default(name: str, facts: dict[str, Any], required: set[str]) -> str:
    return "" if name in required or "default" not in facts else f"`{json.dumps(facts['default'])}`"


def _type(facts: dict[str, Any]) -> str:
    """Say a type in a few words."""
    if "$ref" in facts:
        name = facts["$ref"].rsplit("/", 1)[1]
        return f"[{name}](#{name.lower()})"
    if "anyOf" in facts:
        return " or ".join(_type(option) for option in facts["anyOf"])
    if "const" in facts:
        return f"`{json.dumps(facts['const'])}`"
    if "enum" in facts:
        return ", ".join(f"`{word}`" for word in facts["enum"])
    kind = str(facts.get("type", "any"))
    if kind == "array":
        return _array(facts)
    if kind == "object" and isinstance(facts.get("additionalProperties"), dict):
        return f"object of {_type(facts['additionalProperties'])}"
    return f"{kind}{_range(facts)}"


def _array(facts: dict[str, Any]) -> str:
    low, high = facts.get("minItems"), facts.get("maxItems")
    if "prefixItems" in facts:
        return f"array of {len(facts['prefixItems'])} {_type(facts['prefixItems'][0])}"
    count = f", {low} to {high} of them" if low is not None and high is not None else ""
    return f"array of {_type(facts.get('items', {}))}{count}"


def _range(facts: dict[str, Any]) -> str:
    """Say a number's or a text's bounds."""
    low = facts.get("minimum", facts.get("minLength"))
    high = facts.get("maximum", facts.get("maxLength", facts.get("exclusiveMaximum")))
    unit = " letters" if "maxLength" in facts else ""
    if high is not None:
        below = "below " if "exclusiveMaximum" in facts else ""
        return f", {_number(low or 0)} to {below}{_number(high)}{unit}"
    return f", {_number(low)} or more" if low is not None else ""


def _number(value: float) -> str:
    return f"{value:.15g}"


def _table(columns: tuple[str, ...]) -> str:
    return f"| {' | '.join(columns)} |\n|{'---|' * len(columns)}\n"


def _json(value: Any) -> str:
    return f"```json\n{json.dumps(value)}\n```\n"
