"""Pages of the stream, as they go over the wire."""

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.server.record_desk import RecordDesk
from daemon.storage.journal import Journal
from daemon.wire.operations.records import RecordsReply


async def test_a_page_says_of_which_station_and_journal_it_is_and_what_was_lost(tmp_path: Path) -> None:
    journal = await Journal.open(tmp_path / "j.sqlite")
    journal.stream.set_circumstances({"needle": "N-1"})
    for touches in (3, 4):
        await journal.add_report(None, None, touches)
    with closing(sqlite3.connect(tmp_path / "j.sqlite", isolation_level=None)) as db:
        db.execute("DELETE FROM records WHERE seq=1")  # as trimming does
    told = await RecordDesk("s", journal.stream).records(None, 0, 10)
    page = RecordsReply.model_validate_json(told.to_json())
    assert (page.station, page.journal, page.first_seq) == ("s", await journal.stream.journal(), 1)
    assert page.lost is not None
    assert (page.lost.from_seq, page.lost.to_seq) == (1, 1)
    (record,) = page.records
    assert (record.seq, record.kind, record.circumstances) == (2, "report", {"needle": "N-1"})
    assert record.body == {"n": 2, "job": None, "retest": None, "touches": 4}
    await journal.close()


async def test_a_kind_there_is_none_of_is_refused_with_those_there_are(tmp_path: Path) -> None:
    journal = await Journal.open(tmp_path / "j.sqlite")
    with pytest.raises(Fault, match="alerts") as refused:
        await RecordDesk("s", journal.stream).records(None, 0, 10, ["report", "alerts"])
    assert refused.value.kind is FaultCode.INVALID_REQUEST
    assert "alert, report" in str(refused.value.detail)
    await journal.close()
