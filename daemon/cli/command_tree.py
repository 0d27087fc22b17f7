"""Tree of commands: names, helps and parameters of all commands, read from their signatures.

The manual page and the shells' completions are made of it, so that they know what the command line knows.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import NoneType
from typing import Any, Literal, get_args, get_origin

import typer
from typer.models import ArgumentInfo, OptionInfo


@dataclass(frozen=True)
class Parameter:
    """An argument, which has no flags, or an option."""

    name: str
    flags: tuple[str, ...]
    help: str
    choices: tuple[str, ...]
    is_switch: bool
    is_file: bool
    required: bool
    default: str
    """Empty where there is none worth a word."""

    @property
    def value(self) -> str:
        """Return the word that stands for its value."""
        return "|".join(self.choices) or self.name.upper().replace("_", "-")


@dataclass(frozen=True)
class Command:
    """One command; its path is the words after `reprobe`."""

    path: tuple[str, ...]
    help: str
    parameters: tuple[Parameter, ...]

    @property
    def flags(self) -> tuple[str, ...]:
        """Return all flags of its options."""
        return tuple(flag for parameter in self.parameters for flag in parameter.flags)


def commands_of(app: typer.Typer, above: tuple[str, ...] = ()) -> Iterator[Command]:
    """Yield the commands of an application in their order, without the hidden ones."""
    for command in app.registered_commands:
        callback = command.callback
        if callback is None or command.hidden:
            continue
        name = command.name or callback.__name__.replace("_", "-")
        told = inspect.cleandoc(command.help or callback.__doc__ or "")
        signature = inspect.signature(callback, eval_str=True)
        found = (_parameter(one) for one in signature.parameters.values())
        yield Command((*above, name), told, tuple(one for one in found if one is not None))
    for group in app.registered_groups:
        inner = group.typer_instance
        if inner is not None and not group.hidden:
            yield from commands_of(inner, (*above, str(group.name)))


def _parameter(of: inspect.Parameter) -> Parameter | None:
    kind, *marks = get_args(of.annotation) or (of.annotation,)
    info = next((mark for mark in marks if isinstance(mark, ArgumentInfo | OptionInfo)), None)
    if info is None or info.hidden:
        return None
    named = tuple(flag for one in info.param_decls or () for flag in one.split("/") if flag.startswith("-"))
    flags = () if isinstance(info, ArgumentInfo) else named or (f"--{of.name.replace('_', '-')}",)
    inner = _inner(kind)
    return Parameter(
        name=str(info.metavar or of.name),
        flags=flags,
        help=str(info.help or ""),
        choices=tuple(str(one) for one in get_args(inner)) if get_origin(inner) is Literal else (),
        is_switch=inner is bool,
        is_file=inner is Path,
        required=of.default is of.empty,
        default=_default(of.default),
    )


def _inner(kind: Any) -> Any:
    """Return the kind of one value, without "or none" and "a list of"."""
    while True:
        inner = [one for one in get_args(kind) if one is not NoneType]
        if NoneType in get_args(kind) or get_origin(kind) is list:
            kind = inner[0]
        else:
            return kind


def _default(value: Any) -> str:
    if value is inspect.Parameter.empty or value is None or isinstance(value, bool) or value in ("", [], ()):
        return ""
    return f"{value:g}" if isinstance(value, float) else str(value)
