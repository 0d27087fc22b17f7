"""One-line texts of results and events."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping
from datetime import UTC, datetime
from functools import cache
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
    if text.isprintable():  # nothing of those kinds is
        return text
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
        case "point":
            return f"{escape(event['point'])}: {event['verdict'].replace('_', ' ')}, {event['seconds']:.1f} s"
        case _:
            told = {key: value for key, value in event.items() if key not in ("v", "topic", "seq", "time", "station")}
            return escape(one_line(in_words(told)))


TYPED_AS = {"alerts": "health", "trigger": "correct", "snapshot": "status", "charts": "month"}
"""Operations whose command has another name."""


def as_commands(advice: str) -> str:
    """Return a daemon's words in those of the command line: what it calls `home` is typed as `reprobe home`."""
    if "`" not in advice:
        return advice

    def typed(found: re.Match[str]) -> str:
        return f"`reprobe {TYPED_AS.get(found[1], found[1])}"

    return _named_operation().sub(typed, advice.replace("send `", "type `"))


@cache
def _named_operation() -> re.Pattern[str]:
    """Return what finds the name of an operation in a daemon's words."""
    from daemon.wire.operations.table import OPERATIONS  # noqa: PLC0415  # few commands have any advice to give

    return re.compile(rf"`((?:{'|'.join(OPERATIONS.ops)})(?![\w-]))")


def in_words(value: Any) -> str:
    """Return a value of a reply as a person reads it: no brackets, no None, a list's entries in lines of their own."""
    if value is None or value in ([], {}):  # the pattern {} would match any dictionary
        return "none"
    match value:
        case bool():
            return "yes" if value else "no"
        case float():
            return f"{value:g}" if abs(value) < 1e6 else f"{value:.0f}"
        case dict():
            return ", ".join(
                f"{key.replace('_', ' ')} {_bracketed(inner)}" for key, inner in value.items() if inner != ""
            )
        case list():
            return "".join(f"\n  {in_words(inner)}" for inner in value)
        case _:
            return str(value)


def _bracketed(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(in_words(inner) for inner in value) or "none"
    return f"({in_words(value)})" if isinstance(value, dict) and value else in_words(value)


def sentence(result: JobResult) -> str:
    """Say how a job ended."""
    where = f" {escape(result.test_point)}" if result.test_point else ""
    what = f"{result.detail['what']} " if result.op == "calibrate" and "what" in result.detail else ""
    if result.error is not None:
        why = f"{result.error.name} ({result.error.code}), {escape(as_commands(result.error.message))}"
        return f"[red]{result.op}{f' {what}'.rstrip()}{where} failed[/]: {why}"
    before, after = result.error_before_um, result.error_after_um
    error = "" if before is None else f", {before:.0f} um off" if after is None else f", {before:.0f} -> {after:.0f} um"
    did = [f", {n} {name}{'s'[: n != 1]}" for n, name in ((result.looks, "look"), (result.moves, "move")) if n]
    return f"[green]{what}{result.outcome}[/]{where}{error}{''.join(did)}"


def doubts(detail: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Say what a job that ended well does not know, each with what to do about it."""
    found = []
    if unseen := detail.get("unconfirmed"):
        why = f"nobody has seen the tip there, the drives alone say so: {unseen['message']}"
        found.append((why, as_commands(unseen.get("advice", ""))))
    if detail.get("height") == "unknown":
        aside = f"; a look may see a pad {detail['parallax_um']:.0f} um aside" if "parallax_um" in detail else ""
        why = f"how high the board lies is unknown within {detail['height_within_um']:.0f} um{aside}"
        found.append((why, "`reprobe calibrate surface`; without it nothing is touched"))
    return found


def age(made_at: str) -> str:
    """Return how long ago something was made."""
    hours = (datetime.now(UTC) - datetime.fromisoformat(made_at)).total_seconds() / 3600
    return f"{hours:.1f} h ago" if hours < 48 else f"{hours / 24:.0f} days ago"


def calibrated(calibration: dict[str, Any]) -> str:
    """Say which calibrations are in force, and since when."""
    made = calibration.get("made_at") or {}
    tip = ["tip"] if calibration.get("tip") and "tip" not in made else []
    return ", ".join([*tip, *(f"{what} {age(at)}" for what, at in made.items())]) or "nothing"
