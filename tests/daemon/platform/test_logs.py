"""Every line says which job it belongs to, how grave it is, and nothing secret."""

from __future__ import annotations

import asyncio
import json
import logging
import os
from collections.abc import Iterator
from pathlib import Path
from typing import TextIO

import pytest
import structlog

from daemon.platform.logs import set_up


@pytest.fixture
def stream(tmp_path: Path) -> Iterator[TextIO]:
    """A file to log to; logging is as before afterwards."""
    root = logging.getLogger()
    before = root.handlers[:], root.level
    with (tmp_path / "log").open("w+", encoding="utf-8") as file:
        yield file
    structlog.reset_defaults()
    root.handlers[:], root.level = before[0], before[1]
    logging.getLogger("pymodbus").setLevel(logging.NOTSET)


def _lines(stream: TextIO) -> list[str]:
    stream.flush()
    stream.seek(0)
    return stream.read().splitlines()


def _journal(stream: TextIO, monkeypatch: pytest.MonkeyPatch) -> None:
    facts = os.fstat(stream.fileno())
    monkeypatch.setenv("JOURNAL_STREAM", f"{facts.st_dev}:{facts.st_ino}")


def test_under_systemd_each_event_is_one_line_with_its_priority(
    stream: TextIO, monkeypatch: pytest.MonkeyPatch
) -> None:
    _journal(stream, monkeypatch)
    set_up(as_json=False, stream=stream)
    log = structlog.get_logger()
    log.info("begun", text="two\nlines", number=3)
    log.warning("odd", quoted='say "so"')
    try:
        raise ValueError("broken")
    except ValueError:
        log.exception("failed")
    lines = _lines(stream)
    assert lines[:2] == ['<6>begun text="two\\nlines" number=3', '<4>odd quoted="say \\"so\\""']
    assert lines[2].startswith("<3>failed exception=")
    assert "ValueError: broken" in lines[2]
    assert len(lines) == 3


def test_json_under_systemd_has_the_priority_too(stream: TextIO, monkeypatch: pytest.MonkeyPatch) -> None:
    _journal(stream, monkeypatch)
    set_up(as_json=True, stream=stream)
    structlog.get_logger().error("gone", device="bus")
    (line,) = _lines(stream)
    assert line[:3] == "<3>"
    assert json.loads(line[3:]) == {"event": "gone", "device": "bus"}


def test_a_journal_that_reads_another_stream_gets_no_priorities(
    stream: TextIO, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("JOURNAL_STREAM", "1:1")
    set_up(as_json=True, stream=stream)
    structlog.get_logger().info("here")
    (line,) = _lines(stream)
    assert json.loads(line)["level"] == "info"


async def test_tasks_and_worker_threads_keep_the_job(stream: TextIO) -> None:
    set_up(as_json=True, stream=stream)
    device = structlog.get_logger().bind(device="x")  # as the drivers do, long before any job

    async def task() -> None:
        device.info("task")
        await asyncio.to_thread(device.info, "thread")

    with structlog.contextvars.bound_contextvars(job="j1", op="correct"):
        await asyncio.create_task(task())
    device.info("after")
    lines = [json.loads(line) for line in _lines(stream)]
    assert [(line["event"], line.get("job"), line.get("op")) for line in lines] == [
        ("task", "j1", "correct"),
        ("thread", "j1", "correct"),
        ("after", None, None),
    ]


def test_what_libraries_log_goes_the_same_way(stream: TextIO, monkeypatch: pytest.MonkeyPatch) -> None:
    _journal(stream, monkeypatch)
    set_up(as_json=False, stream=stream)
    with structlog.contextvars.bound_contextvars(job="j1"):
        logging.getLogger("asyncio").error("a task %s", "died")
        logging.getLogger("pymodbus.logging").error("no frame")
        logging.getLogger("asyncio").info("chatter")
    assert _lines(stream) == ["<3>a task died job=j1 logger=asyncio"]


@pytest.mark.parametrize("name", ["secret", "secret_key", "client_token", "Password"])
def test_values_under_a_secrets_name_are_hidden(stream: TextIO, name: str) -> None:
    set_up(as_json=True, stream=stream)
    structlog.get_logger().info("keys", **{name: "s3cr3t", "table": {name: "s3cr3t", "kept": 1}})
    (line,) = _lines(stream)
    assert "s3cr3t" not in line
    assert json.loads(line)["table"]["kept"] == 1
