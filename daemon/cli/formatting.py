"""One-line texts of results and events."""

from __future__ import annotations

import unicodedata
from typing import Any

from rich.markup import escape

from daemon.domain.results import JobResult

HIDDEN = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})
"""Unicode's kinds of letters that show nothing: controls, formats, halves of pairs, ends of lines and paragraphs."""


def visible(text: str) -> str:
    """Return a text with its control characters written out, but for line ends and tabs.

    Names of jobs and messages come from others: sent to a terminal as they are, they could move its cursor, change what
    stands there, or hide, as letters do that turn the direction of writing.
    """
    return "".join(c if c in "\n\t" or unicodedata.category(c) not in HIDDEN else _written(c) for c in text)


def one_line(text: str) -> str:
    """Return a text in one visible line."""
    return visible(text).replace("\n", "\\n").replace("\t", "\\t")


def _written(character: str) -> str:
    code = ord(character)
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


def result_of(event: dict[str, Any]) -> JobResult:
    """Return the result that a `result` event carries."""
    return JobResult.model_validate({key: event[key] for key in JobResult.model_fields if key in event})


def gist(event: dict[str, Any]) -> str:
    """Say an event in a line."""
    match event["topic"]:
        case "state":
            return f"{event['was']} --{event['event']}--> [bold]{event['state']}[/]"
        case "result":
            return sentence(result_of(event))
        case "progress":
            return f"{event['op']}: {event['done']} of {event['total']}, {event['doing']}"
        case _:
            return ", ".join(f"{k}={v}" for k, v in event.items() if k not in ("v", "topic", "seq", "time", "station"))


def sentence(result: JobResult) -> str:
    """Say how a job ended."""
    where = f" {result.test_point}" if result.test_point else ""
    if result.error is not None:
        why = f"{result.error.name} ({result.error.code}), {escape(result.error.message)}"
        return f"[red]{result.op}{where} failed[/]: {why}"
    before, after = result.error_before_um, result.error_after_um
    error = "" if before is None else f", {before:.0f} um off" if after is None else f", {before:.0f} -> {after:.0f} um"
    return f"[green]{result.outcome}[/]{where}{error}, {result.looks} looks, {result.moves} moves"
