"""Output of commands: tables and sentences for people, JSON lines for machines, errors with what to do next."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated, Any, NoReturn

import typer
from rich.console import Console
from rich.text import Text

from daemon.cli.formatting import visible
from daemon.client import DEFAULT_CONTROL, NoAnswer, NotLetIn, Refused
from daemon.wire.curve_keys import KeyTrouble

WIDE = 130
"""Columns of tables that are written to a file or a pipe."""


class VisibleConsole(Console):
    """A console on which control characters of a text are written out; colours come by markup alone."""

    def render_str(self, text: str, **options: Any) -> Text:
        """Render a text, also one inside of a table."""
        return super().render_str(visible(text), **options)


out = VisibleConsole(width=None if sys.stdout.isatty() else WIDE)
err = VisibleConsole(stderr=True)

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON for machines.")]
Endpoint = Annotated[str, typer.Option(help="Control socket of the daemon.", envvar="REPROBE_CONTROL")]
DEFAULT_ENDPOINT = DEFAULT_CONTROL
FAILED, USAGE = 1, 2


def say_json(value: Any) -> None:
    """Print one JSON line."""
    typer.echo(json.dumps(value))


def fail(message: str, *, advice: str = "", code: int = FAILED) -> NoReturn:
    """Say what went wrong and what to do, then end."""
    err.print(f"[bold red]error:[/] {message}", highlight=False, soft_wrap=True)
    if advice:
        err.print(f"  [dim]->[/] {advice}", highlight=False, soft_wrap=True)
    raise typer.Exit(code)


@contextmanager
def answered() -> Iterator[None]:
    """Turn a client's exceptions into an error message and an exit code."""
    try:
        yield
    except Refused as exc:
        fail(f"{exc.error['name']} ({exc.error['code']}): {exc.error['message']}", advice=exc.error["advice"])
    except KeyTrouble as exc:
        fail(str(exc), advice=exc.advice)
    except NotLetIn as exc:
        fail(str(exc), advice="come with a key of that station: --key FILE, or REPROBE_KEY")
    except NoAnswer as exc:
        fail(str(exc), advice="start it with `reprobe run --config station.toml`, or name its --endpoint")
