"""Put the commands together."""

from __future__ import annotations

import typer

from daemon.cli import boards, calibrate, demo, look, serve, teach, tester

app = typer.Typer(
    name="reprobe",
    help="Station daemon that makes a missed probe touch land.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
for commands in (serve.app, tester.app, calibrate.app, look.app, teach.app, boards.app, demo.app):
    app.registered_commands += commands.registered_commands
    app.registered_groups += commands.registered_groups


def main() -> None:
    """Run the command line."""
    app()
