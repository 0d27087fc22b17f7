"""The operator's page beside a demonstration: a process as all others, reached by a browser on this computer."""

from __future__ import annotations

import secrets
import socket
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

PORT = 8460
NEEDS = ("starlette", "uvicorn", "websockets")


@dataclass(frozen=True)
class PageBeside:
    """Where the page is, and how to log in there."""

    station: str
    folder: Path
    port: int
    person: str = "demo"
    password: str = ""

    @property
    def url(self) -> str:
        """Address for a browser."""
        return f"http://127.0.0.1:{self.port}/"

    @property
    def arguments(self) -> list[str]:
        """Return what its process is started with."""
        return [
            "daemon.cli", "page", "--station", self.station, "--state", str(self.folder), "--port", str(self.port),
            "--kiosk",
        ]  # fmt: skip


def is_installed() -> bool:
    """Tell whether the page can be served."""
    return all(find_spec(part) is not None for part in NEEDS)


def new_page(station: str, folder: Path) -> PageBeside:
    """Return a page at the usual port, or at any free one."""
    return PageBeside(station, folder, _free_port(), password=secrets.token_urlsafe(9))


def _free_port() -> int:
    for wanted in (PORT, 0):
        with socket.socket() as found:
            found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                found.bind(("127.0.0.1", wanted))
            except OSError:
                continue
            return int(found.getsockname()[1])
    raise OSError("no port is free")
