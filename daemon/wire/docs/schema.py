"""Documents of the wire, made from rows and models: JSON Schemas and the page `wire.md`.

What is documented is what is spoken: requests are validated by these models, replies and events are built of them, and
a test compares the files in the repository with what this makes.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from pydantic import BaseModel, TypeAdapter
from pydantic.json_schema import JsonSchemaMode

from daemon.platform.atomic_file import replace_whole
from daemon.wire.docs.models import model_schema
from daemon.wire.docs.page import page
from daemon.wire.events import TOPICS
from daemon.wire.operations.table import OPERATIONS, AnyRequest, OperationTable
from daemon.wire.replies import AnyReply, Refusal

DIALECT: Final = "https://json-schema.org/draft/2020-12/schema"


def schemas(operations: OperationTable = OPERATIONS) -> dict[str, dict[str, Any]]:
    """Return name -> JSON Schema of a request, of each operation's reply, of an event, and of the refusal."""
    replies = {row.op: row.reply for row in operations.rows}
    return {
        "request": _schema(operations.requests, "A request", "validation"),
        "reply": _by_key("A good reply, by the operation asked", "op", replies, operations),
        "event": _by_key("An event, by its topic", "topic", TOPICS, operations),
        "error": _schema(TypeAdapter(Refusal), "A refusal", "serialization"),
    }


def write(folder: Path, api: type[BaseModel], more: Mapping[str, str] = MappingProxyType({})) -> list[Path]:
    """Write `wire.md` and `schema/*.schema.json` into a folder; return what was written.

    `api`: the section of the configuration whose defaults the page tells. `more`: name -> text of further pages.
    """
    texts = (
        {folder / name: text for name, text in more.items()}
        | {folder / "wire.md": page(api)}
        | {
            folder / "schema" / f"{name}.schema.json": json.dumps(schema, indent=1, sort_keys=True) + "\n"
            for name, schema in schemas().items()
        }
    )
    for path, text in texts.items():
        _put(path, text)
    return list(texts)


def _put(path: Path, text: str) -> None:
    def put(beside: Path) -> None:
        beside.write_text(text, encoding="utf-8")
        beside.chmod(0o644)

    replace_whole(path, put)


def _schema(adapter: TypeAdapter[Any] | TypeAdapter[AnyRequest], title: str, mode: JsonSchemaMode) -> dict[str, Any]:
    return {"$schema": DIALECT, "title": title, **adapter.json_schema(mode=mode)}


def _by_key(title: str, key: str, models: Mapping[str, type[BaseModel]], operations: OperationTable) -> dict[str, Any]:
    """Return one schema whose `$defs` hold all models; `x-by-<key>` says which is whose.

    Fields with a default are required too, for they are always sent, but for those that a reply leaves out where they
    are None. More fields may come (see the page), so that none of these forbids what it does not know.
    """
    absent = {model.__name__: model.ABSENT for model in models.values() if issubclass(model, AnyReply)}
    schemas = {}
    definitions: dict[str, Any] = {}
    for model in dict.fromkeys(models.values()):
        schema = model_schema(model, operations, "serialization")
        definitions |= schema.pop("$defs", {})
        schemas[model.__name__] = schema
    definitions |= schemas
    for name, definition in definitions.items():
        definition.pop("additionalProperties", None)
        sent = set(definition.get("properties", {})) - absent.get(name, frozenset())
        definition["required"] = sorted({*definition.get("required", ()), *sent})
    return {
        "$schema": DIALECT,
        "title": title,
        "anyOf": [{"$ref": f"#/$defs/{name}"} for name in schemas],
        f"x-by-{key}": {name: f"#/$defs/{model.__name__}" for name, model in models.items()},
        "$defs": definitions,
    }
