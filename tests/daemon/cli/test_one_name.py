"""One thing has one name, on the wire and on the command line; old names go on working and are shown nowhere."""

from __future__ import annotations

import re
import sqlite3
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import typer
import zmq
from typer.testing import CliRunner

from daemon.cli.app import app
from daemon.cli.command_tree import commands_of
from daemon.cli.formatting import as_commands, gist, in_words
from daemon.cli.last_resort import UNFORESEEN, with_words
from daemon.cli.on_demand import whole
from daemon.cli.records import record_in_words
from daemon.domain.errors import FaultCode
from daemon.platform.clock import utc_now
from daemon.wire.operations.table import OPERATIONS

pytestmark = pytest.mark.usefixtures("logging_as_before")
SHOWN = {command.path[0] for command in commands_of(whole())}
TAKEN = {c.name or (c.callback.__name__ if c.callback else "") for c in whole().registered_commands} | SHOWN
OLD = {"trigger": "correct", "alerts": "health"}
PART_OF = {"snapshot": "status", "charts": "month"}
"""Operations that are part of a command: `status` shows all that there is, `month` draws the same charts."""


def _run(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, list(arguments))
    return result.exit_code, result.output


@pytest.mark.parametrize("op", OPERATIONS.ops)
def test_every_operation_of_the_wire_is_a_command_of_that_name(op: str) -> None:
    assert PART_OF.get(op, op) in TAKEN


@pytest.mark.parametrize("old", OLD)
def test_an_old_name_works_and_is_shown_nowhere(old: str) -> None:
    assert _run(old, "--help")[0] == 0
    assert old not in SHOWN
    assert OLD[old] in SHOWN
    assert f" {old} " not in _run("--help")[1]


def test_what_the_months_page_was_called_still_writes_it(tmp_path: Path) -> None:
    code, said = _run("report", "-c", str(tmp_path / "none.toml"), "--month", "2026-11", "-o", str(tmp_path / "x.html"))
    assert code == 2
    assert "none.toml" in said, "it went the way of the month"


@pytest.mark.parametrize("kind", FaultCode, ids=lambda kind: kind.wire_name)
def test_advice_on_the_command_line_names_only_what_can_be_typed(kind: FaultCode) -> None:
    """Every `reprobe word` in it is a command."""
    said = as_commands(kind.value.advice)
    assert "send `" not in said
    for word in re.findall(r"`reprobe ([\w-]+)", said):
        assert word in TAKEN
    assert not set(re.findall(r"`([\w-]+)`", said)) & set(OPERATIONS.ops)


ERROR = {"code": 5101, "name": "not_homed", "message": "[/x] not homed", "advice": "send `home`", "detail": {}}


@contextmanager
def _daemon(folder: Path, reply: dict[str, Any], refused: str = "") -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Answer whatever is asked with one reply; what was asked is in the list."""
    asked: list[dict[str, Any]] = []
    endpoint = f"ipc://{folder}/control"
    context = zmq.Context()
    socket = context.socket(zmq.ROUTER)
    socket.bind(endpoint)
    done = threading.Event()

    def serve() -> None:
        while not done.is_set():
            if socket.poll(20):
                *route, body = socket.recv_multipart()
                asked.append(zmq.utils.jsonapi.loads(body))
                answer = {"v": 1, "ok": True, **reply, **({"ok": False} if asked[-1]["op"] == refused else {})}
                socket.send_multipart([*route, zmq.utils.jsonapi.dumps(answer)])

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield endpoint, asked
    finally:
        done.set()
        thread.join()
        context.destroy(0)


@pytest.mark.parametrize(
    ("words", "op", "fields"),
    [
        (
            ["report", "j1", "--retest", "pass", "--touches", "20"],
            "report",
            {"id": "j1", "retest": "pass", "touches": 20},
        ),
        (["hold", "j1", "--lease-ms", "3000"], "hold", {"id": "j1", "lease_ms": 3000.0}),
        (["result", "j1"], "result", {"id": "j1"}),
        (["results", "--since", "7", "--limit", "3"], "results", {"since": 7, "limit": 3}),
        (["describe"], "describe", {}),
        (["correct", "TP1"], "correct", {"test_point": "TP1"}),
        (["place", "--at", "12500,8000"], "place", {"board_um": [12500.0, 8000.0]}),
        (["history", "--test-point", "TP1", "--limit", "3"], "history", {"test_point": "TP1", "limit": 3}),
        (["audit", "--before", "9"], "audit", {"before": 9}),
        (["note", "login", "--by", "M. Weber"], "note", {"what": "login", "by": "M. Weber"}),
        (["pictures", "j1"], "pictures", {"id": "j1"}),
        (["picture", "j1", "before-red", "-o", "x.jpg"], "picture", {"id": "j1", "which": "before-red"}),
        (["config"], "config", {}),
        (["light", "red", "--lease-ms", "3000"], "light", {"colour": "red", "lease_ms": 3000.0}),
        (["points", "r1"], "points", {"run": "r1"}),
        (["point", "TP1", "--limit", "3"], "point", {"test_point": "TP1", "limit": 3}),
        (["pause", "--id", "r1"], "pause", {"id": "r1"}),
        (["marks"], "marks", {}),
        (["jog", "x", "--um", "-100"], "jog", {"axis": "x", "by_um": -100.0}),
        (
            ["mark", "TP1", "forbidden", "--reason", "lifts", "--by", "Kim"],
            "mark",
            {"test_point": "TP1", "mark": "forbidden", "reason": "lifts", "by": "Kim"},
        ),
        (["records", "--since", "7", "--journal", "J"], "records", {"since": 7, "journal": "J"}),
        (["records", "--kind", "alert", "--kind", "run"], "records", {"kinds": ["alert", "run"]}),
    ],
)
def test_a_command_asks_for_the_operation_of_its_name(
    tmp_path: Path, words: list[str], op: str, fields: dict[str, Any]
) -> None:
    with _daemon(tmp_path, {"ok": False, "error": ERROR}) as (endpoint, asked):
        code, said = _run(*words, "--endpoint", endpoint)
    assert code == 1
    assert "type `reprobe home`" in said
    assert "[/x]" in said
    assert asked
    if op == asked[-1]["op"]:
        assert asked[-1] | fields == asked[-1]
    else:
        assert asked[-1]["op"] == "status", "which was refused before"


RESULT = {
    "id": "j1", "op": "correct", "ok": True, "seq": 7, "station": "s", "finished_at": "2026-01-02T03:04:05Z",
    "outcome": "corrected", "test_point": "TP1", "board_id": "SN-[1]",
}  # fmt: skip
ORDER = {
    "n": 3, "at": "2026-01-02T03:04:05Z", "client": "page", "role": "maintain", "by": "[M.] Weber", "op": "home",
    "fields": {"id": "h1"}, "outcome": "homed",
}  # fmt: skip


@pytest.mark.parametrize(
    ("words", "reply", "says"),
    [
        (["history"], {"results": [RESULT], "more": False}, "SN-[1]"),
        (["audit"], {"entries": [ORDER], "more": False}, "[M.] Weber"),
        (["pictures", "j1"], {"id": "j1", "pictures": ["before-red"]}, "before-red"),
        (["pictures", "j1"], {"id": "j1", "pictures": []}, "none are kept of j1"),
        (
            ["config"],
            {"settings": [{"name": "api.live", "value": None, "source": "default"}], "refused": []},
            "api.live",
        ),
    ],
)
def test_what_is_kept_is_told_as_it_is(tmp_path: Path, words: list[str], reply: dict[str, Any], says: str) -> None:
    with _daemon(tmp_path, reply) as (endpoint, _):
        code, said = _run(*words, "--endpoint", endpoint)
    assert code == 0
    assert says in said


def test_a_kept_picture_is_written_to_the_file_that_was_named(tmp_path: Path) -> None:
    with _daemon(tmp_path, {"id": "j1", "which": "before-red", "jpeg": "/9j/"}) as (endpoint, _):
        code, _ = _run("picture", "j1", "before-red", "-o", str(tmp_path / "a.jpg"), "--endpoint", endpoint)
    assert (code, (tmp_path / "a.jpg").read_bytes()) == (0, b"\xff\xd8\xff")


def test_a_reset_that_leaves_but_homing_ends_well_on_the_command_line(tmp_path: Path) -> None:
    """It says that it worked, and what is left."""
    told = ERROR | {"message": "the reset worked; what is left is to home", "detail": {"reset": "done"}}
    for error, exits in ((told, 0), (ERROR, 1)):
        with _daemon(tmp_path, {"ok": True, "error": error, "state": "fault"}, refused="reset") as (endpoint, _):
            code, said = _run("reset", "--endpoint", endpoint)
            as_json = _run("reset", "--endpoint", endpoint, "--json")
        assert (code, as_json[0]) == (exits, exits)
        assert "`reprobe home`" in said
        assert ("the reset worked" in said) == (exits == 0)


@pytest.mark.parametrize("made", [{}, {"map": "2026-01-02T03:04:05Z", "backlash": "2026-01-02T03:04:05Z"}])
def test_what_a_new_tip_will_make_void_is_said_before_it_is_taught(tmp_path: Path, made: dict[str, str]) -> None:
    told = {"calibration": {"made_at": made}, "error": ERROR}
    with _daemon(tmp_path, told, refused="look") as (endpoint, _):
        said = _run("calibrate", "tip", "--page", str(tmp_path / "tip.html"), "--endpoint", endpoint)[1]
    assert ("makes void: map (made" in said) == bool(made)
    assert "backlash" not in said, "the tip has no part in it"


def test_a_place_is_asked_for_with_its_two_numbers(tmp_path: Path) -> None:
    assert _run("place")[0] == 2
    assert _run("place", "TP1", "--at", "1,2")[0] == 2
    assert _run("place", "--at", "1;2")[0] == 2


@pytest.mark.parametrize("topic", ["alert", "heartbeat", "contact", "log"])
def test_no_event_is_printed_as_a_dictionary(topic: str) -> None:
    event = {"v": 1, "topic": topic, "seq": 1, "time": utc_now(), "station": "s", "a": {"b": [1.5, None]}, "c": None,
             "d": [{"e": True}]}  # fmt: skip
    assert not set("{}[]'") & set(gist(event))
    assert "None" not in gist(event)


@pytest.mark.parametrize("trouble", [sqlite3.DatabaseError, EOFError, type("Foreign", (Exception,), {})])
def test_a_trouble_of_any_kind_ends_in_words(trouble: type[Exception], monkeypatch: pytest.MonkeyPatch) -> None:
    """A library's own kind of exception is no child of Python's."""
    monkeypatch.delenv("REPROBE_TRACEBACK", raising=False)
    troubled = typer.Typer()

    @troubled.command()
    def fails() -> None:
        raise trouble("it broke")

    with_words(troubled)
    result = CliRunner().invoke(troubled, [])
    assert result.exit_code == 1
    assert UNFORESEEN in result.output
    assert "Traceback" not in result.output


def test_what_a_status_says_in_several_words_is_shown_and_not_called_none() -> None:
    said = in_words({"tip": True, "made_at": {"map": "2026-01-31"}, "not_used": {}, "z_um": None})
    assert said == "tip yes, made at (map 2026-01-31), not used none, z um none"
    assert (in_words({}), in_words([]), in_words(None)) == ("none", "none", "none")
    assert in_words({"run": 3, "stopped_by": ""}) == "run 3", "what is empty is no word"


def test_an_order_that_is_kept_twice_says_first_what_became_of_it() -> None:
    order = {"n": 7, "client": "kim", "role": "operate", "by": "Kim", "op": "home", "outcome": None}
    assert record_in_words("order", order).startswith("op home, outcome taken, n 7")
    assert record_in_words("order", order | {"outcome": "homed"}).startswith("op home, outcome homed, n 7")
    assert record_in_words("touch", {"n": 7, "op": "x"}) == "n 7, op x"
