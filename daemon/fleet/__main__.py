"""`python -m daemon.fleet`: an uplink or a collector, as `reprobe uplink` and `reprobe collect` start them."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import sys
from collections.abc import Coroutine
from pathlib import Path
from typing import Any

from daemon.fleet.broker import BadConnection, Broker
from daemon.fleet.collector import Collector, Keeping
from daemon.fleet.counts import Counts
from daemon.fleet.daemon_link import DaemonLink
from daemon.fleet.topics import BadName
from daemon.fleet.uplink import Place, Uplink
from daemon.platform.logs import set_up
from daemon.wire.curve_keys import KeyTrouble, PrivateKey, read_private

USAGE = 2
AGAIN_S = 2.0
CREDENTIALS = "CREDENTIALS_DIRECTORY"
"""Environment variable by which systemd names the folder of keys."""
DATABASE = "REPROBE_DATABASE"
"""Environment variable with the database's address, which may hold a password and so is no argument."""


def main(arguments: list[str]) -> int:
    """Work until SIGTERM or Ctrl-C; return the exit code, 2 with words for what cannot be."""
    told = json.loads(arguments[0])
    set_up(as_json=told["as_json"])
    try:
        asyncio.run(_until_told(_uplink(told) if told["part"] == "uplink" else _collect(told)))
    except (BadConnection, BadName, KeyTrouble) as exc:
        return _fail(str(exc), exc.advice)
    except OSError as exc:
        return _fail(f"the port for Prometheus cannot be had: {exc.strerror or exc}", "take another --metrics-port")
    return 0


def _fail(message: str, advice: str) -> int:
    sys.stderr.write(f"error: {message}\n  -> {advice}\n")
    return USAGE


async def _until_told(work: Coroutine[Any, Any, None]) -> None:
    told = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, told.set)
    await until(told, asyncio.ensure_future(work))


async def until(told: asyncio.Event, work: asyncio.Task[None]) -> None:
    """Work until told to end; raise what the work raises.

    It is cancelled until it ends: a task group whose parts are failing at that moment swallows it (Python 3.11).
    """
    waiting = asyncio.ensure_future(told.wait())
    await asyncio.wait({work, waiting}, return_when=asyncio.FIRST_COMPLETED)
    waiting.cancel()
    while not work.done():
        work.cancel()
        await asyncio.wait({work}, timeout=AGAIN_S)
    if not work.cancelled():
        work.result()


async def _uplink(told: dict[str, Any]) -> None:
    daemon = DaemonLink(told["station"], _key(_path(told["keys"])))
    try:
        await Uplink(daemon, _broker(told), Place(told["site"], told["line"])).run()
    finally:
        daemon.close()


async def _collect(told: dict[str, Any]) -> None:
    counts = Counts()
    if told["metrics_port"]:
        counts.serve(told["metrics_port"])
    keeping = Keeping(told["recent_days"], told["record_months"])
    await Collector(_broker(told), os.environ[DATABASE], keeping, counts).run()


def _broker(told: dict[str, Any]) -> Broker:
    files = (_path(told[name]) for name in ("ca", "certificate", "certificate_key"))
    return Broker.of(told["broker"], *files)


def _key(file: Path | None) -> PrivateKey | None:
    """Return the key; None where the daemon asks for none, and systemd was given none to hand over."""
    if file is None:
        return None
    by_system = str(file.parent) == os.environ.get(CREDENTIALS)
    if by_system and not file.exists():
        return None
    return read_private(file, kept_by_system=by_system)


def _path(text: str | None) -> Path | None:
    return None if text is None else Path(text)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
