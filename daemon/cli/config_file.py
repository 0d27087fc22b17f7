"""Option `--config`, and loading of the station's configuration for commands that need it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from daemon.cli.output import USAGE, fail
from daemon.config.model import Config, ConfigError, load_config

ConfigFile = Annotated[Path, typer.Option("--config", "-c", help="The station's TOML file.", envvar="REPROBE_CONFIG")]


def load(path: Path) -> Config:
    """Return the configuration, or end with everything that is wrong with it."""
    try:
        return load_config(path)
    except ConfigError as exc:
        fail(str(exc), advice=f"correct it, then try `reprobe check-config {path}`", code=USAGE)
