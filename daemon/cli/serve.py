"""`reprobe serve`, `reprobe sim`: start the daemon, or the simulated station."""

from __future__ import annotations

import asyncio
import errno
import faulthandler
import importlib.util
import os
import sys
from pathlib import Path
from typing import Annotated

import typer
import zmq

from daemon.app.service import Service
from daemon.cli.config_file import ConfigFile, load
from daemon.cli.output import USAGE, fail
from daemon.domain.errors import Fault
from daemon.platform.instance_lock import NotAloneError
from daemon.platform.logs import set_up
from daemon.storage.unfinished_restore import HalfRestoredError
from daemon.wire.curve_keys import KeyTrouble

app = typer.Typer(name="reprobe", add_completion=False, pretty_exceptions_enable=False)
_SOCKETS = {
    errno.EADDRINUSE: "is another daemon running on these sockets?",
    errno.ENOENT: "make the folder in which api.control, api.events and api.live are to lie",
    errno.EACCES: "let the daemon's user write in the folder of api.control and api.events",
}


@app.command()
def serve(
    config: ConfigFile, as_json: Annotated[bool, typer.Option("--json", help="Log in JSON lines.")] = False
) -> None:
    """Run the daemon until SIGTERM or Ctrl-C."""
    run_daemon(config, as_json=as_json)


def run_daemon(config: Path, *, as_json: bool) -> None:
    """Run the daemon; end with words if it cannot start."""
    loaded = load(config)
    set_up(as_json=as_json)
    # A watchdog ends a hung daemon by SIGABRT: where it hung is then in the log.
    if not faulthandler.is_enabled():
        faulthandler.enable()
    try:
        asyncio.run(Service(loaded, config).run())
    except ValueError as exc:
        fail(str(exc), advice=f"correct it, then try `reprobe check-config {config}`", code=USAGE)
    except KeyTrouble as exc:
        fail(str(exc), advice=exc.advice, code=USAGE)
    except (Fault, NotAloneError, HalfRestoredError) as exc:
        fail(str(exc), advice=exc.advice)
    except zmq.ZMQError as exc:
        fail(f"cannot start: {exc}", advice=_SOCKETS.get(exc.errno or 0, "see api.control and api.events"))
    except OSError as exc:
        fail(
            f"cannot start: {exc}",
            advice="see that station.data_dir is a folder, and the daemon's user may write there",
        )


@app.command(
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True, "help_option_names": []},
    help="Run the simulated station; all arguments are its own (see reprobe sim --help).",
)
def sim(context: typer.Context) -> None:
    """Become the simulated station: a process of its own that is reached by its wires only."""
    if importlib.util.find_spec("gerbonara") is None:
        fail("the simulated station is not installed", advice="pip install 'reprobe[sim]'", code=USAGE)
    os.execv(sys.executable, [sys.executable, "-m", "sim_hw", *context.args])  # noqa: S606  # no shell is wanted
