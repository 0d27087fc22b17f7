"""Process of the page: `reprobe page` becomes it, so that nothing of the rest of the program stays in memory."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from daemon.page.people import UserTrouble
from daemon.page.serve import BadServing, Serving, run
from daemon.platform.logs import set_up
from daemon.wire.curve_keys import KeyTrouble

PATHS = ("keys", "state", "certificate", "certificate_key")
USAGE = 2


def serving_of(told: dict[str, Any]) -> Serving:
    """Return how to serve, as the command line told it in JSON."""
    paths = {name: Path(told[name]) for name in PATHS if told[name] is not None}
    lists = {name: tuple(told[name]) for name in ("names", "watchers")}
    return Serving(**{**told, **paths, **lists})


def main(arguments: list[str]) -> int:
    """Serve until told to end; return the exit code."""
    told = json.loads(arguments[0])
    set_up(as_json=told.pop("as_json"))
    serving = serving_of(told)
    sys.stderr.write(f"page: {serving.url}\n")
    try:
        run(serving)
    except (BadServing, KeyTrouble, UserTrouble) as exc:
        return _fail(str(exc), exc.advice)
    except OSError as exc:
        return _fail(f"cannot serve on {serving.host}, port {serving.port}: {exc.strerror or exc}",
                     "take another --port or --host, and see that the certificate may be read")  # fmt: skip
    return 0


def _fail(message: str, advice: str) -> int:
    sys.stderr.write(f"error: {message}\n  -> {advice}\n")
    return USAGE


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
