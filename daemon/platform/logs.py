"""Logging: one structured line an event, for people on a terminal, as JSON, or for systemd's journal.

Under systemd (`JOURNAL_STREAM` names the very stream that is written to) each line begins with its priority, `<3>` for
an error, so that `journalctl -p err` works and the journal's own time is the only one. Job id and op are bound by
the job runner and stand on every line of it, whichever task or worker thread says it. What other libraries log
goes the same way. Nothing secret is written: values under a secret's name are replaced.
"""

from __future__ import annotations

import logging
import os
import sys
from typing import TextIO

import structlog
from structlog.typing import EventDict, Processor, WrappedLogger

PRIORITY = {"critical": 2, "exception": 3, "error": 3, "warn": 4, "warning": 4, "info": 6, "debug": 7}
"""Level -> what sd-daemon(3) calls it."""
SECRET_WORDS = ("secret", "password", "passphrase", "token", "credential", "private_key")
HIDDEN = "(hidden)"
FIRST = ["event", "job", "op"]


def set_up(*, as_json: bool, level: int = logging.INFO, stream: TextIO | None = None) -> None:
    """Set logging up for this process; lines go to `stream`, standard error by default."""
    stream = stream or sys.stderr
    journal = under_journal(stream)
    processors: list[Processor] = [
        structlog.contextvars.merge_contextvars,
        structlog.processors.add_log_level,
        hide_secrets,
        structlog.processors.format_exc_info,
    ]
    if not journal:
        processors.append(structlog.processors.TimeStamper(fmt="iso", utc=True))
    structlog.configure(
        processors=[*processors, *_rendering(stream, as_json=as_json, journal=journal)],
        wrapper_class=structlog.make_filtering_bound_logger(level),
        logger_factory=structlog.PrintLoggerFactory(stream),
    )
    logging.basicConfig(handlers=[_Onward()], level=logging.WARNING, force=True)
    # pymodbus tells of every lost frame through logging; the bus driver says the same with the device's name.
    logging.getLogger("pymodbus").setLevel(logging.CRITICAL)


def under_journal(stream: TextIO) -> bool:
    """Tell whether systemd's journal reads this stream, as systemd.exec(5) says to find out."""
    named = os.environ.get("JOURNAL_STREAM", "")
    try:
        facts = os.fstat(stream.fileno())
    except (OSError, ValueError):
        return False
    return named == f"{facts.st_dev}:{facts.st_ino}"


def hide_secrets(_logger: WrappedLogger, _method: str, event: EventDict) -> EventDict:
    """Replace what stands under a secret's name, also within a value that is a table."""
    return _without_secrets(event)


def _without_secrets(table: EventDict) -> EventDict:
    shown: EventDict = {}
    for key, value in table.items():
        if any(word in str(key).lower() for word in SECRET_WORDS):
            shown[key] = HIDDEN
        else:
            shown[key] = _without_secrets(value) if isinstance(value, dict) else value
    return shown


def priority_prefix(_logger: WrappedLogger, _method: str, event: EventDict) -> EventDict:
    """Take the level out of the event and remember it as the prefix of its line."""
    event["_priority"] = PRIORITY.get(event.pop("level", "info"), 6)
    return event


class JournalLine:
    """Render one event as `<6>event job=... op=... key=value`, in one line whatever it holds."""

    def __init__(self, *, as_json: bool) -> None:
        self._json = structlog.processors.JSONRenderer() if as_json else None

    def __call__(self, logger: WrappedLogger, method: str, event: EventDict) -> str:
        """Return the line."""
        priority = event.pop("_priority")
        if self._json is not None:
            return f"<{priority}>{self._json(logger, method, event)!s}"
        name = str(event.pop("event", "")).replace("\n", " ")
        first = [key for key in FIRST if key in event]
        rest = [key for key in event if key not in FIRST]
        return f"<{priority}>" + " ".join([name, *(f"{key}={_word(event[key])}" for key in [*first, *rest])])


def _word(value: object) -> str:
    """Return a value as one word; quotes and line ends are written as in C."""
    text = str(value).replace("\\", "\\\\").replace("\n", "\\n").replace("\r", "\\r")
    if text and not any(sign in text for sign in ' "=\\'):
        return text
    return '"' + text.replace('"', '\\"') + '"'


def _rendering(stream: TextIO, *, as_json: bool, journal: bool) -> list[Processor]:
    if journal:
        return [priority_prefix, JournalLine(as_json=as_json)]
    if as_json:
        return [structlog.processors.JSONRenderer()]
    return [structlog.dev.ConsoleRenderer(colors=stream.isatty())]


class _Onward(logging.Handler):
    """Hand on what libraries say through `logging`, so that it too has its job, its form and its priority."""

    def emit(self, record: logging.LogRecord) -> None:
        """Say it again, under the library's name."""
        say = structlog.get_logger(record.name)
        say.log(record.levelno, record.getMessage(), logger=record.name, exc_info=record.exc_info)
