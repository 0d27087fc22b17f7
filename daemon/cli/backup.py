"""`reprobe backup` and `reprobe restore`: a station's own things in one archive, and back."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer

from daemon.cli.config_file import load
from daemon.cli.output import USAGE, AsJson, err, fail, out, say_json
from daemon.config.model import ConfigError
from daemon.platform.instance_lock import NotAloneError
from daemon.tools.backup import BackupError, Manifest, contents, make_backup, read_manifest
from daemon.tools.backup import restore as put_back

app = typer.Typer()
STATION = Path("/etc/reprobe/station.toml")
ConfigFile = Annotated[Path, typer.Option("--config", "-c", help="The station's TOML file.", envvar="REPROBE_CONFIG")]


@app.command()
def backup(
    config: ConfigFile = STATION,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="The archive to write; by default STATION-DATE.reprobe.tar.gz."),
    ] = None,
    with_keys: Annotated[
        bool, typer.Option("--with-keys", help="Private keys too: keep the archive as you keep the keys.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Write configuration, board file, calibrations, plans and journal into one archive; also while the daemon runs.

    Pictures are left out, and so are keys, unless you ask for them.
    """
    station = load(config).station.name
    now = datetime.now().astimezone().strftime("%Y%m%d-%H%M%S")
    target = output or Path(f"{_as_file_name(station)}-{now}.reprobe.tar.gz")
    try:
        manifest = make_backup(config, target, with_keys=with_keys)
    except BackupError as exc:
        fail(str(exc), advice=exc.advice)
    except FileExistsError:
        fail(f"{target} is there already", advice="choose another name: an older backup is never overwritten")
    if as_json:
        say_json({"file": str(target), "manifest": manifest.model_dump()})
        return
    out.print(
        f"{target}: station {manifest.station}, {target.stat().st_size / 1e6:.1f} MB", markup=False, soft_wrap=True
    )
    _say(manifest)


@app.command()
def restore(
    archive: Annotated[Path, typer.Argument(help="What `reprobe backup` wrote.")],
    config: ConfigFile = STATION,
    other_station: Annotated[
        bool, typer.Option("--other-station", help="Also where the backup is of another station.")
    ] = False,
    with_keys: Annotated[bool, typer.Option("--with-keys", help="Put the keys in the archive back, too.")] = False,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Do not ask.")] = False,
    as_json: AsJson = False,
) -> None:
    """Put a backup back while the daemon is stopped; what is there is moved aside, nothing is deleted.

    All is read and proved before anything changes. Interrupted, the daemon does not start until it was run again.
    """
    try:
        manifest = read_manifest(archive)
        if not as_json:
            err.print(f"{archive}: station {manifest.station}, made {manifest.made_at}", markup=False, soft_wrap=True)
        if not yes:
            _require_yes(f"put it in the place of {config} and of what that names?")
        restored = put_back(archive, config, other_station=other_station, with_keys=with_keys)
    except BackupError as exc:
        fail(str(exc), advice=exc.advice)
    except NotAloneError as exc:
        fail(str(exc), advice="stop it first: systemctl stop reprobe")
    except ConfigError as exc:
        fail(str(exc), advice="nothing was changed", code=USAGE)
    if as_json:
        say_json({"manifest": manifest.model_dump(), "aside": [str(path) for path in restored.aside]})
        return
    _say(restored.manifest)
    for path in restored.aside:
        out.print(f"what was there before: {path}", markup=False, soft_wrap=True)
    out.print(
        "next: start the daemon, `reprobe home`, and `reprobe align`: where the board lies now is not in a backup"
    )


def _say(manifest: Manifest) -> None:
    for line in contents(manifest):
        out.print(f"  {line}", highlight=False, markup=False)


def _as_file_name(name: str) -> str:
    return "".join(letter if letter.isalnum() or letter in "-_" else "_" for letter in name)


def _require_yes(question: str) -> None:
    """End unless a person says yes; where nobody is there to ask, say how it is done without."""
    try:
        said_yes = typer.confirm(question, err=True)
    except typer.Abort:
        err.print()
        fail("nobody answered, and nothing was changed", advice="say --yes, and it is put back without being asked")
    if not said_yes:
        fail("nothing was changed", advice="call it again, and answer y")
