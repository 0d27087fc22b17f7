"""Commands loaded on demand: the module of a command is imported when that command is asked for.

The list of all commands, suggestions for a mistyped one and the wrong ones' refusal need no module at all.
"""

from __future__ import annotations

import importlib
from functools import cache
from typing import Any

import typer
from typer.core import TyperCommand

from daemon.cli.command_table import COMMANDS, Row
from daemon.cli.plain_usage import PlainGroup


class OnDemand(PlainGroup):
    """All commands of the table; what stands in for each until it is asked for knows its name and help alone."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings | {"commands": {row.name: _stand_in(row) for row in COMMANDS}})

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the command that is asked for, loaded, with its name and the words that are left for it."""
        name, stand_in, rest = super().resolve_command(ctx, args)
        return name, stand_in and _command(str(stand_in.name)), rest


@cache
def loaded(module: str) -> typer.Typer:
    """Return the commands of a module, with what all commands have."""
    from daemon.cli.client_keys import with_keys  # noqa: PLC0415  # the list of commands does without it
    from daemon.cli.last_resort import with_words  # noqa: PLC0415  # as above

    app: typer.Typer = importlib.import_module(f"daemon.cli.{module}").app
    with_keys(app)
    with_words(app)
    return app


def whole() -> typer.Typer:
    """Return all commands, loaded, in the order of the table: for what tells of each option of each."""
    app = typer.Typer(add_completion=False)
    for module in dict.fromkeys(row.module for row in COMMANDS):
        app.registered_commands += loaded(module).registered_commands
        app.registered_groups += loaded(module).registered_groups
    return app


def _stand_in(row: Row) -> TyperCommand:
    return TyperCommand(row.name, help=row.help, hidden=row.hidden)


def _command(name: str) -> Any:
    (module,) = (row.module for row in COMMANDS if row.name == name)
    return typer.main.get_group(loaded(module)).commands[name]
