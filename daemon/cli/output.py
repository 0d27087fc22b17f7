"""Output of commands: tables and sentences for people, JSON lines for machines, errors with what to do next."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated, Any, NoReturn

import typer
from rich.console import Console
from rich.errors import MarkupError
from rich.markup import escape
from rich.text import Text

from daemon.cli.formatting import as_commands, visible
from daemon.cli.plain_usage import in_plain_words
from daemon.client import DEFAULT_CONTROL, NoAnswer, NotLetIn, Refused
from daemon.platform.finite_json import to_json
from daemon.wire.curve_keys import KeyTrouble

WIDE = 130
"""Columns of tables that are written to a file or a pipe."""


class VisibleConsole(Console):
    """A console on which control characters of a text are written out; colours come by markup alone."""

    def render_str(self, text: str, **options: Any) -> Text:
        """Render a text, also one inside of a table; brackets that are no markup are shown as they are."""
        try:
            return super().render_str(visible(text), **options)
        except MarkupError:
            return super().render_str(visible(text), **options | {"markup": False})


out = VisibleConsole(width=None if sys.stdout.isatty() else WIDE, emoji=False)
err = VisibleConsole(stderr=True, emoji=False)

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON for machines.")]
Endpoint = Annotated[str, typer.Option(help="Control socket of the daemon.", envvar="REPROBE_CONTROL")]
DEFAULT_ENDPOINT = DEFAULT_CONTROL
FAILED, USAGE = 1, 2


def say_json(value: Any) -> None:
    """Print one JSON line; what is no number, or infinite, is null."""
    typer.echo(to_json(value))


def fail(message: str, *, advice: str = "", code: int = FAILED) -> NoReturn:
    """Say what went wrong and what to do, as it is written, then end."""
    err.print(f"[bold red]error:[/] {escape(as_commands(message))}", highlight=False, soft_wrap=True)
    say_cure(advice, to=err)
    raise typer.Exit(code)


def say_cure(advice: str, *, to: VisibleConsole | None = None, indent: int = 2) -> None:
    """Say what to do, in a line of its own and in words that can be typed; nothing where there is no advice."""
    if advice:
        line = f"{' ' * indent}[dim]->[/] {escape(as_commands(advice))}"
        (to or out).print(line, highlight=False, soft_wrap=True)


def _wrong_fields(detail: Any) -> str:
    """Return what is wrong with the fields of a request, where a refusal names any."""
    listed = detail.get("fields") if isinstance(detail, dict) else None
    wrong = [one for one in listed or () if isinstance(one, dict) and "field" in one and "problem" in one]
    return "; ".join(f"{one['field']}: {in_plain_words(str(one['problem']))}" for one in wrong)


@contextmanager
def answered() -> Iterator[None]:
    """Turn a client's exceptions into an error message and an exit code."""
    try:
        yield
    except Refused as exc:
        error = exc.error
        if wrong := _wrong_fields(error.get("detail")):
            fail(f"{error['name']} ({error['code']}): {wrong}", advice="give other values, and send it again")
        fail(f"{error['name']} ({error['code']}): {error['message']}", advice=error["advice"])
    except KeyTrouble as exc:
        fail(str(exc), advice=exc.advice)
    except NotLetIn as exc:
        fail(str(exc), advice="come with a key of that station: --key FILE, or REPROBE_KEY")
    except NoAnswer as exc:
        fail(str(exc), advice="start it with `reprobe serve --config station.toml`, or name its --endpoint")
