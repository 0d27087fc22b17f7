"""The command line: one group of all commands, each loaded when it is asked for."""

from __future__ import annotations

from typing import Annotated

import typer

from daemon.cli.on_demand import OnDemand

app = typer.Typer(
    name="reprobe",
    cls=OnDemand,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


def _say_version(wanted: bool) -> None:  # noqa: FBT001  # typer hands it so
    if wanted:
        from importlib.metadata import version  # noqa: PLC0415  # it costs more than most commands

        typer.echo(f"reprobe {version('reprobe')}")
        raise typer.Exit


@app.callback()
def _root(
    said: Annotated[  # its callback prints it
        bool, typer.Option("--version", help="Say which version this is.", is_eager=True, callback=_say_version)
    ] = False,
) -> None:
    """Station daemon that makes a missed probe touch land."""


def main() -> None:
    """Run the command line."""
    app()
