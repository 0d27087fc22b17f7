"""An id is answered the same way for ever, and nobody waits for an answer that cannot come."""

from pathlib import Path
from typing import Any, cast

import pytest

from daemon.config.model import ServoSection
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.results import JobResult
from daemon.domain.states import Machine
from daemon.jobs.runner import JobRunner
from daemon.platform.clock import utc_now
from daemon.storage.journal import Journal
from daemon.wire.operations.jobs import Home, Place

HOME = Home(op="home", id="a")
WRITTEN = HOME.model_dump_json(exclude={"wait", "deadline_ms"})


def _jobs(journal: Journal) -> JobRunner:
    nobody = cast("Any", None)  # neither events nor pictures are reached by an id that is known
    return JobRunner(Machine(lambda *_: None), journal, nobody, nobody, "s", ServoSection(), {}, queue_length=4)


async def test_a_known_id_is_answered_from_the_journal_and_only_for_the_same_request(tmp_path: Path) -> None:
    journal = await Journal.open(tmp_path / "j.sqlite")
    await journal.add_job("a", "home", WRITTEN)
    result = JobResult(id="a", op="home", ok=True, seq=1, station="s", finished_at=utc_now(), outcome="homed")
    await journal.finish_job(result)
    assert await (await _jobs(journal).submit(HOME)) == result
    with pytest.raises(Fault) as caught:
        await _jobs(journal).submit(Place(op="place", id="a", test_point="TP1"))
    assert caught.value.kind is FaultCode.ID_REUSED
    await journal.close()


async def test_a_job_whose_result_was_never_written_is_an_error_and_no_endless_wait(tmp_path: Path) -> None:
    journal = await Journal.open(tmp_path / "j.sqlite")
    await journal.add_job("a", "home", WRITTEN)
    with pytest.raises(Fault) as caught:
        await _jobs(journal).submit(HOME)
    assert caught.value.kind is FaultCode.JOURNAL_FAILED
    await journal.close()
