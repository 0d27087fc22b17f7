"""No raw traceback in any wrong invocation of the command line: they are made from the commands' own parameters."""

from __future__ import annotations

import inspect
import itertools
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import NoneType
from typing import Any, Literal, get_args, get_origin

import pytest
import typer
from typer.models import ArgumentInfo, OptionInfo
from typer.testing import CliRunner

from daemon.cli.app import app
from daemon.cli.last_resort import UNFORESEEN
from daemon.cli.on_demand import whole
from daemon.client import KEY_VARIABLE, Client

NOBODY = "ipc:///nonexistent/reprobe-test"
STARTS_SOMETHING = {"sim", "demo"}
"""These hand their arguments to other programs, or start them."""
pytestmark = pytest.mark.usefixtures("logging_as_before")


@dataclass(frozen=True)
class Parameter:
    """One parameter of a command, as its signature has it."""

    name: str
    flag: str
    """Empty for an argument by its place."""
    kind: Any
    required: bool

    def words(self, value: str) -> list[str]:
        return [self.flag, value] if self.flag else [value]


def _commands(of: typer.Typer, above: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], list[Parameter]]]:
    for command in of.registered_commands:
        callback = command.callback
        assert callback is not None
        name = command.name or callback.__name__.replace("_", "-")
        signature = inspect.signature(callback, eval_str=True)
        yield (*above, name), [_parameter(one) for one in signature.parameters.values() if get_args(one.annotation)]
    for group in of.registered_groups:
        inner = group.typer_instance
        assert inner is not None
        yield from _commands(inner, (*above, group.name or inner.info.name or ""))


def _parameter(of: inspect.Parameter) -> Parameter:
    kind, *marks = get_args(of.annotation)
    info = next(mark for mark in marks if isinstance(mark, ArgumentInfo | OptionInfo))
    flags = [one for one in info.param_decls or () if one.startswith("--")]
    flag = flags[0].split("/")[0] if flags else f"--{of.name.replace('_', '-')}"
    kinds = [one for one in get_args(kind) if one is not NoneType] if NoneType in get_args(kind) else [kind]
    return Parameter(of.name, "" if isinstance(info, ArgumentInfo) else flag, kinds[0], of.default is of.empty)


def _inner(kind: Any) -> Any:
    return get_args(kind)[0] if get_origin(kind) is list else kind


def _plain(parameter: Parameter) -> str:
    """Return a value that is of the right kind."""
    kind = _inner(parameter.kind)
    if get_origin(kind) is Literal:
        return str(get_args(kind)[0])
    return {int: "1", float: "1", Path: "none.toml"}.get(kind, "TP1")


def _wrong(parameter: Parameter, files: list[str]) -> list[str]:
    """Return values that are of the wrong kind, out of any range, or no such file."""
    kind = _inner(parameter.kind)
    if kind is bool:
        return []
    if kind is Path:
        return files
    if kind in (int, float):
        return ["ten", "nan", "-1e999", ""]
    return ["", "\x1b[2J\x00"[:4], "é" * 500, "--", "12,x", "[/x]"]


def _invocations(files: list[str]) -> Iterator[list[str]]:
    """Yield wrong command lines: each parameter wrong with the others right, left out, doubled, unknown."""
    for name, parameters in _commands(whole()):
        if name[0] in STARTS_SOMETHING:
            continue
        needed = [one for one in parameters if one.required]
        endpoint = ["--endpoint", NOBODY] if any(one.name == "endpoint" for one in parameters) else []
        yield [*name, "--no-such-option"]
        yield [*name, *endpoint, *itertools.chain(*(one.words(_plain(one)) for one in needed)), "too", "many", "words"]
        if needed:
            yield [*name, *endpoint]
        for parameter in parameters:
            beside = [word for one in needed if one != parameter for word in one.words(_plain(one))]
            where = [] if parameter.name == "endpoint" else endpoint
            for value in _wrong(parameter, files):
                yield [*name, *where, *beside, *parameter.words(value)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with files that are none of those that are meant."""
    folder = tmp_path_factory.mktemp("wrong")
    (folder / "a-folder").mkdir()
    (folder / "empty").touch()
    (folder / "not-utf-8").write_bytes(bytes(range(128, 256)) * 10)
    (folder / "noise.toml").write_bytes(b"\x00\xff[[[=" * 100)
    (folder / "huge").touch()
    os.truncate(folder / "huge", 40_000_000)
    (folder / "list.json").write_text("[1, 2, {}]")
    (folder / "unreadable").touch(mode=0o000)
    os.mkfifo(folder / "pipe")
    return folder


FILES = [
    "nowhere/none",
    "a-folder",
    "empty",
    "not-utf-8",
    "noise.toml",
    "huge",
    "list.json",
    "unreadable",
    "pipe",
    "",
    "[/x]",
    "[b]/y",
]
INVOCATIONS = list(_invocations(FILES))


CODES = {0, 1, 2}
OWN_CODES = {"probe": {3}, "run": {3}}
"""Of commands whose code is a verdict: 3 is that nobody knows."""


def test_there_are_two_hundred_at_least() -> None:
    assert len(INVOCATIONS) >= 200


@pytest.mark.parametrize("command", sorted({words[0] for words in INVOCATIONS}))
def test_no_wrong_invocation_ends_in_a_traceback(command: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each ends with an exit code of its own, and words where something failed."""
    monkeypatch.chdir(folder)
    monkeypatch.setattr(Client, "raw", _at_once(Client.raw))
    monkeypatch.delenv("REPROBE_TRACEBACK", raising=False)
    monkeypatch.setattr(os, "execv", _becomes_another)
    runner = CliRunner()
    wrong: list[str] = []
    for words in (one for one in INVOCATIONS if one[0] == command):
        monkeypatch.setenv(KEY_VARIABLE, "")  # --key is put there
        result = runner.invoke(app, words)
        said = result.output
        ended = result.exception is None or isinstance(result.exception, SystemExit)
        if (
            not ended
            or "Traceback" in said
            or UNFORESEEN in said
            or result.exit_code not in CODES | OWN_CODES.get(command, set())
        ):
            wrong.append(f"{words!r:.200} -> {result.exit_code} {result.exception!r:.200} {said:.300}")
        elif result.exit_code and not said.strip():
            wrong.append(f"{words!r:.200} -> {result.exit_code} without a word")
    assert not wrong, "\n".join(wrong)


def _becomes_another(*_: object) -> None:
    """Stand for the program that a command becomes: the tests' own process must not."""
    raise SystemExit(0)


def _at_once(raw: Any) -> Any:
    """Do not wait for a daemon that is not there."""

    def ask(client: Client, message: bytes, *, timeout_s: float | None = None) -> dict[str, Any]:
        answer: dict[str, Any] = raw(client, message, timeout_s=0.01)
        return answer

    return ask
