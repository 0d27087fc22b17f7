"""Audit trail: who gave which order, written down before it is carried out and completed when it is over.

The trail never holds an order up: a `cancel` must go through on a station whose disk is full or slow. What could not be
written is said in the log.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable

import structlog

from daemon.domain.errors import Fault
from daemon.domain.roles import Caller
from daemon.station.device_errors import as_fault
from daemon.storage.journal import Journal
from daemon.wire.operations.jobs import JobReply
from daemon.wire.replies import Reply
from daemon.wire.requests import Request

WAIT_S = 0.5
"""So long an answer waits for the disk to have its outcome."""
ENVELOPE = {"v", "op", "by", "tag", "deadline_ms", "wait"}
log = structlog.get_logger(__name__)


class AuditTrail:
    """Write orders down."""

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self._writing: set[asyncio.Task[None]] = set()

    async def around(self, op: str, request: Request, caller: Caller, work: Awaitable[Reply]) -> Reply:
        """Carry an order out between its two entries; return or raise what it does."""
        fields = request.model_dump_json(exclude=ENVELOPE, exclude_unset=True)
        begun = asyncio.create_task(self._journal.begin_order(caller.client, caller.role, request.by, op, fields))
        # It stands in the writer's queue, and so before whatever the order writes, when this has yielded once.
        await asyncio.sleep(0)
        outcome = "internal"
        try:
            reply = await work
            outcome = _outcome(reply)
            return reply
        except Exception as exc:
            outcome = as_fault(exc).kind.wire_name
            raise
        finally:
            completing = asyncio.create_task(self._complete(op, begun, outcome))
            self._writing.add(completing)
            completing.add_done_callback(self._writing.discard)
            await asyncio.wait({completing}, timeout=WAIT_S)

    async def _complete(self, op: str, begun: asyncio.Task[int], outcome: str) -> None:
        try:
            await self._journal.end_order(await begun, outcome)
        except Fault as exc:
            log.warning("order_not_written", op=op, outcome=outcome, error=exc.message)


def _outcome(reply: Reply) -> str:
    """Say in a word how an order ended."""
    if not isinstance(reply, JobReply):
        return "done"
    if reply.result is None:
        return "taken"
    return reply.result.error.name if reply.result.error is not None else reply.result.outcome
