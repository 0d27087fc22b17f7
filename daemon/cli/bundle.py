"""`reprobe bundle`: the support bundle, for help from afar."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from daemon.cli.config_file import ConfigFile
from daemon.cli.output import USAGE, AsJson, fail, out, say_json
from daemon.tools.support_bundle import collect

app = typer.Typer()


@app.command()
def bundle(
    config: ConfigFile,
    output: Annotated[Path, typer.Option("--output", "-o", help="The archive to write.")] = Path("bundle.tar.gz"),
    pictures_mb: Annotated[float, typer.Option(min=0, help="Room for pictures of the last failed jobs.")] = 20.0,
    unit: Annotated[str, typer.Option(help="The daemon's unit, for its log.")] = "reprobe.service",
    as_json: AsJson = False,
) -> None:
    """Write a support bundle: configuration, versions, journal, calibrations, pictures, metrics, log; no secrets."""
    if not config.is_file():
        fail(f"{config} is no file", advice="name the station's file: -c /etc/reprobe/station.toml", code=USAGE)
    collected, station = collect(config, pictures_bytes=int(pictures_mb * 1e6), unit=unit)
    try:
        collected.write(output, station)
    except OSError as exc:
        fail(f"cannot write {output}: {exc}", advice="see that its folder is there and that you may write into it")
    if as_json:
        say_json({"file": str(output), "parts": list(collected.parts), "left_out": collected.left_out})
        return
    out.print(
        f"{output}: {len(collected.parts)} parts, {output.stat().st_size / 1e6:.1f} MB", markup=False, soft_wrap=True
    )
    for name, why in collected.left_out.items():
        out.print(f"  left out: [bold]{escape(name)}[/], {escape(why)}", highlight=False, soft_wrap=True)
