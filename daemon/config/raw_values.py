"""Values of a configuration file as it was read, by dotted path: for checks that go on where other fields are wrong."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from copy import deepcopy
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo


class RawValues:
    """A parsed file beside the models that say what belongs into it."""

    def __init__(self, raw: dict[str, Any], root: type[BaseModel]) -> None:
        self._raw, self._root = raw, root

    def at(self, path: str) -> Any:
        """Return what stands at a path, or its default; None where there is neither."""
        value: Any = self._raw
        for part in path.split("."):
            if not isinstance(value, dict) or part not in value:
                info = field_at(self._root, path)
                return None if info is None or info.is_required() else info.get_default()
            value = value[part]
        return value

    def given(self, path: str) -> bool:
        """Tell whether it stands in the file."""
        value: Any = self._raw
        for part in path.split("."):
            if not isinstance(value, dict) or part not in value:
                return False
            value = value[part]
        return True

    def number(self, path: str) -> float | None:
        """Return a finite number; None if it is missing or something else."""
        value = self.at(path)
        if isinstance(value, bool) or not isinstance(value, int | float):
            return None
        try:
            number = float(value)
        except OverflowError:  # a whole number of hundreds of digits
            return None
        return number if math.isfinite(number) else None

    def with_numbers(self, numbers: Mapping[str, float]) -> RawValues:
        """Return the same with other numbers at some paths, in tables that are there."""
        raw = deepcopy(self._raw)
        for path, number in numbers.items():
            *above, key = path.split(".")
            table = raw
            for part in above:
                table = table[part]
            table[key] = number
        return RawValues(raw, self._root)

    def text(self, path: str) -> str | None:
        """Return a text; None if it is missing or something else."""
        value = self.at(path)
        return value if isinstance(value, str) else None

    def table(self, path: str) -> dict[str, Any]:
        """Return a table; empty if it is missing or something else."""
        value = self.at(path)
        return value if isinstance(value, dict) else {}

    def wrong_kinds(self) -> Iterator[tuple[str, str]]:
        """Yield path and words for each value that would be taken for another kind: `true` for 1, "5" for 5."""
        yield from _wrong_kinds(self._raw, self._root, "")


def field_at(root: type[BaseModel], path: str) -> FieldInfo | None:
    """Return the field of a dotted path; None if there is none, or it is no field but a name in a table."""
    model: type[BaseModel] | None = root
    info: FieldInfo | None = None
    parts = path.split(".")
    while parts:
        if model is None or (info := model.model_fields.get(parts.pop(0))) is None:
            return None
        model, named = model_of(info.annotation)
        if named and parts:
            parts.pop(0)
            info = None
    return info


def model_at(root: type[BaseModel], path: str) -> type[BaseModel] | None:
    """Return the model of the table at a dotted path; None if it is no table."""
    if not path:
        return root
    model: type[BaseModel] | None = root
    parts = path.split(".")
    while parts:
        info = model.model_fields.get(parts.pop(0)) if model is not None else None
        if info is None:
            return None
        model, named = model_of(info.annotation)
        if named:
            if not parts:
                return None
            parts.pop(0)
    return model


def model_of(annotation: Any) -> tuple[type[BaseModel] | None, bool]:
    """Return the model of a field's annotation, and whether it stands there under names (`dict[str, Model]`)."""
    for kind in _alternatives(annotation):
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            return kind, False
        if get_origin(kind) is dict:
            inner = get_args(kind)[1]
            if isinstance(inner, type) and issubclass(inner, BaseModel):
                return inner, True
    return None, False


def _alternatives(annotation: Any) -> tuple[Any, ...]:
    """Return the kinds that a value may be of, each without its limits."""
    if get_origin(annotation) in (Union, UnionType):
        return tuple(_bare(kind) for kind in get_args(annotation) if kind is not NoneType)
    return (_bare(annotation),)


def _bare(kind: Any) -> Any:
    return get_args(kind)[0] if get_origin(kind) is Annotated else kind


def _wrong_kinds(raw: dict[str, Any], model: type[BaseModel], above: str) -> Iterator[tuple[str, str]]:
    for key, value in raw.items():
        info = model.model_fields.get(key)
        if info is None:
            continue
        path = f"{above}{key}"
        inner, named = model_of(info.annotation)
        if inner is not None and isinstance(value, dict):
            tables = {f"{path}.{name}": table for name, table in value.items()} if named else {path: value}
            for where, table in tables.items():
                if isinstance(table, dict):
                    yield from _wrong_kinds(table, inner, f"{where}.")
        elif trouble := _wrong_kind(value, set(_alternatives(info.annotation))):
            yield path, trouble


def _wrong_kind(value: Any, wanted: set[Any]) -> str:
    numbers = {int, float} & wanted or any(
        get_origin(kind) is Literal and all(isinstance(one, int) for one in get_args(kind)) for kind in wanted
    )
    if isinstance(value, bool) and numbers and bool not in wanted:
        return f"{str(value).lower()} is no number; write the number"
    if isinstance(value, str) and numbers and str not in wanted:
        return f"{value!r} is a text; write the number, without quotes"
    if not isinstance(value, bool) and bool in wanted:
        return f"{value!r} is neither true nor false; write one of them, without quotes"
    return ""
