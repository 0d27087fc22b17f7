"""JSON that every reader takes: the format has no infinity and no NaN, and Python writes both all the same."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any


def to_json(value: Any, *, indent: int | None = None) -> str:
    """Return a value as JSON; a number that is none, or has no end, is null. TypeError for what JSON cannot say."""
    return json.dumps(_finite(value), indent=indent, allow_nan=False)


def _finite(value: Any) -> Any:
    match value:
        case float():
            return value if math.isfinite(value) else None
        case Mapping():
            return {_key(key): _finite(inner) for key, inner in value.items()}
        case list() | tuple():
            return [_finite(inner) for inner in value]
        case _:
            return value


def _key(key: Any) -> Any:
    """Return a key as it is; one that is no number, or has no end, by its name: a key cannot be null."""
    return str(key) if isinstance(key, float) and not math.isfinite(key) else key
