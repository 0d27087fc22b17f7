"""Answers to `records`: pages of the stream of all that is kept."""

from __future__ import annotations

from collections.abc import Collection

from daemon.domain.errors import Fault, FaultCode
from daemon.storage.record_stream import RecordStream
from daemon.storage.record_tables import SOURCES
from daemon.wire.operations.records import JournalEnd, Lost, NumberedFacts, RecordsReply


class RecordDesk:
    """Hand out the records of one station."""

    def __init__(self, station: str, stream: RecordStream) -> None:
        self._station, self._stream = station, stream

    async def records(
        self, journal: str | None, since: int, limit: int, kinds: Collection[str] | None = None
    ) -> RecordsReply:
        """Answer one page; raise `Fault` for a kind there is none of, or where the journal cannot be read."""
        if unknown := sorted(set(kinds or ()) - SOURCES.keys()):
            raise Fault(
                FaultCode.INVALID_REQUEST,
                f"no record is of the kind {', '.join(unknown)}",
                fields=[{"field": "kinds", "problem": f"one of {', '.join(SOURCES)}"}],
            )
        page = await self._stream.read(journal, since, limit, kinds)
        return RecordsReply(
            station=self._station,
            journal=page.journal,
            first_seq=page.first_seq,
            previous=JournalEnd(journal=page.previous[0], seq=page.previous[1]) if page.previous else None,
            lost=Lost(from_seq=page.lost[0], to_seq=page.lost[1]) if page.lost else None,
            records=[NumberedFacts(**record._asdict()) for record in page.records],
            through_seq=page.through_seq,
            oldest_seq=page.oldest_seq,
            next_seq=page.next_seq,
        )
