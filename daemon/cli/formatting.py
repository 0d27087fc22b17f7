"""One-line texts of results and events."""

from __future__ import annotations

from typing import Any

from rich.markup import escape

from daemon.domain.results import JobResult


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
