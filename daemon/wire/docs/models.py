"""JSON Schema of one model, with the words of its fields that the rows of operations decide."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import JsonSchemaMode

from daemon.wire.operations.table import OperationTable


def model_schema(model: type[BaseModel], operations: OperationTable, mode: JsonSchemaMode) -> dict[str, Any]:
    """Return a model's schema; `outcome`, wherever a result is, lists how the jobs of `operations` can end."""
    schema = model.model_json_schema(mode=mode)
    for part in (schema, *schema.get("$defs", {}).values()):
        outcome = part.get("properties", {}).get("outcome")
        if outcome is not None:
            outcome["description"] = f"{', '.join(operations.outcomes)} or failed"
    return schema
