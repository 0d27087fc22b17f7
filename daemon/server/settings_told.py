"""Settings as they are told to clients: each by its name in the file, with where it comes from.

What names a place on the computer is left out: paths, ports of devices and addresses of sockets.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import BaseModel

from daemon.wire.operations.describe import Setting


def settings_told(config: BaseModel) -> list[Setting]:
    """Return every setting in force, in the order of the model."""
    return list(_told(config, ""))


def _told(section: BaseModel, before: str) -> Iterator[Setting]:
    for name in type(section).model_fields:
        given = name in section.model_fields_set
        yield from _one(f"{before}{name}", getattr(section, name), given=given)


def _one(name: str, value: Any, *, given: bool) -> Iterator[Setting]:
    if isinstance(value, BaseModel):
        yield from _told(value, f"{name}.")
    elif isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _one(f"{name}.{key}", inner, given=given)
    elif isinstance(value, list | tuple | set | frozenset):
        yield Setting(name=name, value=", ".join(map(str, value)), source=_source(given=given))
    elif value is None or (isinstance(value, str | int | float | bool) and not _is_place(value)):
        plain = float(value) if isinstance(value, int) and not isinstance(value, bool) else value
        yield Setting(name=name, value=plain, source=_source(given=given))


def _is_place(value: object) -> bool:
    """Whether a text names a file, a device or an address."""
    return isinstance(value, str) and ("/" in value or "\\" in value)


def _source(*, given: bool) -> Any:
    return "file" if given else "default"
