"""Option `--key` for every command that speaks to a daemon."""

from __future__ import annotations

import functools
import inspect
import os
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from daemon.client import KEY_VARIABLE

KeyFile = Annotated[
    Path | None,
    typer.Option(
        "--key", envvar=KEY_VARIABLE, help="This client's private key, where the daemon asks for one (`reprobe keys`)."
    ),
]


def with_keys(app: typer.Typer) -> None:
    """Give `--key` to all commands of an application that have an endpoint; what they do needs no word about it."""
    for command in app.registered_commands:
        if command.callback is not None and "endpoint" in inspect.signature(command.callback).parameters:
            command.callback = _keyed(command.callback)
    for group in app.registered_groups:
        if group.typer_instance is not None:
            with_keys(group.typer_instance)


def _keyed(callback: Callable[..., Any]) -> Callable[..., Any]:
    """Return the command with the option, whose value it puts where clients look for it."""
    signature = inspect.signature(callback, eval_str=True)
    if "key" in signature.parameters:
        return callback
    key = inspect.Parameter("key", inspect.Parameter.KEYWORD_ONLY, default=None, annotation=KeyFile)

    @functools.wraps(callback)
    def command(*args: Any, key: Path | None = None, **fields: Any) -> Any:
        if key is not None:
            os.environ[KEY_VARIABLE] = str(key)
        return callback(*args, **fields)

    command.__signature__ = signature.replace(parameters=[*signature.parameters.values(), key])  # type: ignore[attr-defined]
    command.__annotations__ = {p.name: p.annotation for p in (*signature.parameters.values(), key)}
    return command
