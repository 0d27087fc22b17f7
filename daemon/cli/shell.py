"""`reprobe completion` and `reprobe manual`: what a shell and `man` know of the commands."""

from __future__ import annotations

from importlib.metadata import version
from typing import Annotated, Literal

import typer

from daemon.cli.command_tree import commands_of
from daemon.cli.completion import SHELLS
from daemon.cli.manual import manual as page
from daemon.cli.on_demand import whole

app = typer.Typer()
Shell = Literal["bash", "zsh", "fish"]


@app.command()
def completion(shell: Annotated[Shell, typer.Argument(help="Which shell.")]) -> None:
    """Print a shell's completion script; `reprobe install` puts it where the shell finds it.

    Without installing: source <(reprobe completion bash)
    """
    typer.echo(SHELLS[shell](commands_of(whole())), nl=False)


@app.command()
def manual() -> None:
    """Print the manual page, as man(1) reads it; `reprobe install` puts it in its place."""
    typer.echo(page(commands_of(whole()), version("reprobe")), nl=False)


def made_files() -> dict[str, str]:
    """Return place below the root -> text, of the files that are made from the commands."""
    known = list(commands_of(whole()))
    return {
        "usr/local/share/man/man1/reprobe.1": page(known, version("reprobe")),
        "usr/local/share/bash-completion/completions/reprobe": SHELLS["bash"](known),
        "usr/local/share/zsh/site-functions/_reprobe": SHELLS["zsh"](known),
        "usr/local/share/fish/vendor_completions.d/reprobe.fish": SHELLS["fish"](known),
    }
