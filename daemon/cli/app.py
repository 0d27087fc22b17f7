"""The command line put together from its commands."""

from __future__ import annotations

import typer

from daemon.cli import (
    bundle,
    calibrate,
    demo,
    doctor,
    health,
    import_board,
    install,
    journal,
    keys,
    look,
    schema,
    serve,
    teach,
    tester,
    watch,
)
from daemon.cli.client_keys import with_keys

app = typer.Typer(
    name="reprobe",
    help="Station daemon that makes a missed probe touch land.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
for commands in (
    serve.app,
    tester.app,
    watch.app,
    calibrate.app,
    look.app,
    teach.app,
    import_board.app,
    health.app,
    journal.app,
    keys.app,
    doctor.app,
    bundle.app,
    install.app,
    schema.app,
    demo.app,
):
    app.registered_commands += commands.registered_commands
    app.registered_groups += commands.registered_groups
with_keys(app)


def main() -> None:
    """Run the command line."""
    app()
