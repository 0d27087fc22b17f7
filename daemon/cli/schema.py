"""`reprobe schema`: the wire in writing."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from daemon.cli.output import USAGE, fail, out, say_json
from daemon.config.sections.service import ApiSection
from daemon.tools.messages import page as messages
from daemon.wire.docs.schema import schemas, write

app = typer.Typer()


@app.command()
def schema(
    out_folder: Annotated[
        Path | None, typer.Option("--out", "-o", help="Write wire.md, messages.md and schema/*.json into this folder.")
    ] = None,
) -> None:
    """Print the JSON Schemas of everything on the wire, or write them with the pages that explain it."""
    if out_folder is None:
        say_json(schemas())
        return
    try:
        written = write(out_folder, ApiSection, {"messages.md": messages()})
    except OSError as exc:
        fail(f"{out_folder} cannot be written: {exc.strerror}", advice="choose a folder that is yours", code=USAGE)
    for path in written:
        out.print(path, highlight=False, soft_wrap=True)
