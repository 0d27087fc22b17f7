"""Link to the station's daemon: pages of records and how the station is, asked with a key that may observe."""

from __future__ import annotations

import asyncio
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Any

from daemon.client import Client, Keys, NoAnswer, Refused
from daemon.fleet.send_window import Position

PAGE = 100


class DaemonLink:
    """Ask the daemon, one question at a time, in a thread of its own."""

    def __init__(self, endpoint: str, keys: Keys) -> None:
        """Connect; raise `KeyTrouble` if the key cannot be used."""
        self._client = Client(endpoint, keys=keys)
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="daemon")

    async def page(self, position: Position) -> dict[str, Any]:
        """Return one page of records; raise `NoAnswer` or `Refused`."""
        journal, since = position
        asked: dict[str, Any] = {"since": since, "limit": PAGE} | ({} if journal is None else {"journal": journal})
        return await self._ask("records", **asked)

    async def name(self) -> str:
        """Return the station's name; raise `NoAnswer` or `Refused`."""
        return str((await self._ask("status"))["station"])

    async def state(self) -> dict[str, Any]:
        """Return how the station is, in few words; that it does not answer is one."""
        with suppress(NoAnswer, Refused):
            status = await self._ask("status")
            alerts = await self._ask("alerts", since=2**62, limit=1)
            fault = status.get("fault")
            return {
                "online": True, "daemon": True, "state": status["state"], "lifecycle": status["lifecycle"],
                "program": status["version"], "fault": fault["name"] if fault else None,
                "alerts": [alert["name"] for alert in alerts["standing"]],
                "calibrated": status["calibration"]["made_at"],
            }  # fmt: skip
        return {"online": True, "daemon": False, "state": None, "fault": None, "alerts": []}

    async def _ask(self, op: str, **fields: Any) -> dict[str, Any]:
        def ask() -> dict[str, Any]:
            return self._client.request(op, **fields)

        return await asyncio.get_running_loop().run_in_executor(self._thread, ask)

    def close(self) -> None:
        """Let go of it."""
        self._thread.submit(self._client.close).result()
        self._thread.shutdown()
