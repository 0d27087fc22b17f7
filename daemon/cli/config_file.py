"""Option `--config`, and loading of the station's configuration for commands that need it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from daemon.cli.output import USAGE, fail

if TYPE_CHECKING:
    from daemon.config.model import Config

ConfigFile = Annotated[Path, typer.Option("--config", "-c", help="The station's TOML file.", envvar="REPROBE_CONFIG")]


def load(path: Path) -> Config:
    """Return the configuration, or end with everything that is wrong with it."""
    from daemon.config.model import ConfigError, load_config  # noqa: PLC0415  # who reads none does not wait for it

    try:
        return load_config(path)
    except ConfigError as exc:
        there = f"correct it, then try `reprobe check-config {path}`"
        elsewhere = "name the station's file, --config FILE or REPROBE_CONFIG; `reprobe check-config FILE` checks one"
        fail(str(exc), advice=there if path.exists() else elsewhere, code=USAGE)
