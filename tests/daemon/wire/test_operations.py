"""One row per operation: names, validation, roles, documents and dispatch follow from it."""

from __future__ import annotations

import ast
import dataclasses
import re
from pathlib import Path
from typing import Any, Literal, get_args

import pytest
from pydantic import ValidationError

import daemon
from daemon.config.sections.service import ApiSection
from daemon.domain.errors import Fault, FaultCode
from daemon.domain.roles import ROLES, Caller, Role
from daemon.wire.docs.page import page
from daemon.wire.docs.schema import schemas
from daemon.wire.operations import control, describe, health, jobs, records
from daemon.wire.operations.row import DefaultDeadline, Operation
from daemon.wire.operations.table import OPERATIONS, AnyRequest, OperationTable
from daemon.wire.replies import Reply
from daemon.wire.requests import ImmediateRequest, JobRequest, Request

NONE, SHORT = DefaultDeadline.NONE, DefaultDeadline.SHORT
JOB, LENGTHY_JOB = DefaultDeadline.JOB, DefaultDeadline.LENGTHY_JOB
KEPT: dict[str, tuple[Role, DefaultDeadline]] = {
    "correct": ("operate", JOB),
    "place": ("operate", JOB),
    "look": ("operate", JOB),
    "align": ("operate", LENGTHY_JOB),
    "calibrate": ("maintain", LENGTHY_JOB),
    "home": ("maintain", JOB),
    "lift": ("operate", JOB),
    "cancel": ("operate", SHORT),
    "reset": ("maintain", SHORT),
    "light": ("operate", SHORT),
    "status": ("observe", NONE),
    "snapshot": ("observe", NONE),
    "result": ("observe", SHORT),
    "results": ("observe", SHORT),
    "alerts": ("observe", SHORT),
    "acknowledge": ("operate", SHORT),
    "report": ("operate", SHORT),
    "describe": ("observe", NONE),
    "config": ("observe", NONE),
    "history": ("observe", SHORT),
    "audit": ("maintain", SHORT),
    "note": ("operate", SHORT),
    "pictures": ("observe", SHORT),
    "picture": ("observe", SHORT),
}
"""Operations whose role and deadline clients rely on, in the order of the page; a new one need not be added."""
MODULES = {jobs: jobs.AnyJob, control: control.AnyControl, health: health.AnyHealth, describe: describe.AnyDescription,
           records: records.AnyRecord}  # fmt: skip
SOURCE = Path(daemon.__file__).parent
ASKERS = ("cli/", "tools/", "page/", "client.py")
"""Parts of the program that send requests, as any client does."""
RULES_OF_THEIR_OWN = {"correct", "look", "calibrate", "home", "lift", "touch", "probe", "run"}
"""Operations that some files treat in a way of their own, such as `home` and `lift`, which are allowed in fault.

The word `probe` is also what some call the needle, and `run` that of which a point's record is a part.
"""


class Wipe(JobRequest):
    """Wipe the tip on the brush."""

    op: Literal["wipe"]
    strokes: int = 3


class WipeNow(ImmediateRequest):
    """Wipe on the spot."""

    op: Literal["wipe"]


class WipeReply(Reply):
    """It will be wiped."""

    brush: str


WIPE = Operation(
    request=Wipe,
    reply=WipeReply,
    least_role="operate",
    deadline=DefaultDeadline.LENGTHY_JOB,
    outcomes=("wiped",),
    example={"id": "wipe-1", "strokes": 5},
    example_reply={"id": "wipe-1", "brush": "left"},
)


@pytest.fixture(scope="module")
def extended() -> OperationTable:
    """Today's operations and one more."""
    return OperationTable((*OPERATIONS.rows, WIPE))


# --- rows and unions ------------------------------------------------------------------------------------------


def test_every_operation_has_exactly_one_row() -> None:
    assert OPERATIONS.ops == tuple(row.op for row in OPERATIONS.rows)
    assert len(set(OPERATIONS.ops)) == len(OPERATIONS.rows)
    assert [OPERATIONS.row(op).op for op in OPERATIONS.ops] == list(OPERATIONS.ops)


def test_operations_keep_their_role_deadline_and_order() -> None:
    assert {op: (OPERATIONS.row(op).least_role, OPERATIONS.row(op).deadline) for op in KEPT} == KEPT
    assert [op for op in OPERATIONS.ops if op in KEPT] == list(KEPT)


@pytest.mark.parametrize(("module", "union"), MODULES.items(), ids=lambda value: getattr(value, "__name__", ""))
def test_rows_and_the_union_for_the_type_checker_name_the_same_requests(module: Any, union: Any) -> None:
    assert tuple(row.request for row in module.ROWS) == (get_args(union) or (union,))


def test_the_union_of_all_requests_is_all_rows() -> None:
    assert get_args(AnyRequest) == tuple(row.request for row in OPERATIONS.rows)


def test_two_rows_of_one_name_are_refused(extended: OperationTable) -> None:
    with pytest.raises(ValueError, match="two operations of one name"):
        OperationTable((*extended.rows, WIPE))


@pytest.mark.parametrize(
    "change",
    [
        {"deadline": DefaultDeadline.SHORT},
        {"outcomes": ()},
        {"request": WipeNow},
        {"request": WipeNow, "outcomes": ()},
        {"request": WipeNow, "outcomes": (), "deadline": DefaultDeadline.SHORT},
    ],
)
def test_a_row_that_contradicts_itself_is_refused(change: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="wipe"):
        dataclasses.replace(WIPE, **change)


def test_a_request_without_a_name_of_its_own_makes_no_row() -> None:
    with pytest.raises(ValueError, match="JobRequest names no operation"):
        dataclasses.replace(WIPE, request=JobRequest)


# --- roles ----------------------------------------------------------------------------------------------------


def test_each_role_may_all_that_the_one_before_it_may() -> None:
    for op in OPERATIONS.ops:
        allowed = [OPERATIONS.may(role, op) for role in ROLES]
        assert allowed == sorted(allowed)
        assert allowed[-1]


def test_who_only_observes_starts_no_job() -> None:
    assert not [row.op for row in OPERATIONS.rows if row.is_job and OPERATIONS.may("observe", row.op)]


def test_who_may_not_ask_is_told_which_role_is_needed() -> None:
    OPERATIONS.require(Caller("tester", "operate"), "place")
    with pytest.raises(Fault, match="home needs the role maintain, this key has operate") as caught:
        OPERATIONS.require(Caller("tester", "operate"), "home")
    assert caught.value.kind is FaultCode.NOT_ALLOWED
    assert (caught.value.detail["needs"], caught.value.detail["role"]) == ("maintain", "operate")


@pytest.mark.parametrize("ask", [OPERATIONS.row, lambda op: OPERATIONS.may("maintain", op)])
def test_nobody_may_ask_for_what_has_no_row(ask: Any) -> None:
    with pytest.raises(Fault) as caught:
        ask("an operation nobody has listed")
    assert caught.value.kind is FaultCode.UNKNOWN_OP
    assert caught.value.detail["ops"] == list(OPERATIONS.ops)


# --- one more operation ---------------------------------------------------------------------------------------


def test_one_more_row_is_understood_and_checked(extended: OperationTable) -> None:
    request: Request = extended.parse({"op": "wipe", "id": "w", "strokes": 2})
    assert request == Wipe(op="wipe", id="w", strokes=2)
    with pytest.raises(Fault) as caught:
        extended.parse({"op": "wipe", "id": "w", "strokes": "many"})
    assert [field["field"] for field in caught.value.detail["fields"]] == ["strokes"]


def test_one_more_row_has_its_role_and_deadline(extended: OperationTable) -> None:
    assert [extended.may(role, "wipe") for role in ROLES] == [False, True, True]
    assert extended.row("wipe").is_job
    assert extended.row("wipe").is_lengthy


def test_one_more_row_is_on_the_page_with_sentence_role_and_examples(extended: OperationTable) -> None:
    text = page(ApiSection, extended)
    assert "### wipe\n\nWipe the tip on the brush. Role: operate.\n" in text
    assert '{"v": 1, "op": "wipe", "id": "wipe-1", "strokes": 5}' in text
    assert "Reply: It will be wiped.\n" in text
    assert " and `wipe` are jobs." in text
    assert re.search(r"^\| operate \| .*`wipe` \|$", text, re.MULTILINE)
    assert ", wiped or failed" in text
    assert "wipe" not in page(ApiSection)


def test_one_more_row_is_in_the_schemas(extended: OperationTable) -> None:
    made = schemas(extended)
    assert made["request"]["discriminator"]["mapping"]["wipe"] == "#/$defs/Wipe"
    assert made["reply"]["x-by-op"]["wipe"] == "#/$defs/WipeReply"
    assert made["reply"]["$defs"]["JobResult"]["properties"]["outcome"]["description"].endswith("wiped or failed")
    assert "brush" in made["reply"]["$defs"]["WipeReply"]["required"]


def test_a_wrong_example_does_not_reach_the_page() -> None:
    wrong = dataclasses.replace(WIPE, example_reply={"id": "wipe-1"})
    with pytest.raises(ValidationError, match="brush"):
        page(ApiSection, OperationTable((*OPERATIONS.rows, wrong)))


# --- three files ----------------------------------------------------------------------------------------------


def _names(path: Path) -> set[str]:
    """Return the classes a file defines, what it imports from elsewhere, and its texts of one word."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.ImportFrom):
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            found.add(repr(node.value))
    return found


@pytest.fixture(scope="module")
def sources() -> dict[str, set[str]]:
    """File of the daemon -> what it names."""
    paths = {path.relative_to(SOURCE).as_posix(): path for path in SOURCE.rglob("*.py")}
    return {name: _names(path) for name, path in paths.items() if not name.startswith(ASKERS)}


@pytest.mark.parametrize("row", [r for r in OPERATIONS.rows if r.op not in RULES_OF_THEIR_OWN], ids=lambda row: row.op)
def test_an_operation_is_named_by_its_row_and_its_body_and_nowhere_else(
    row: Operation, sources: dict[str, set[str]]
) -> None:
    """With its test these are the three files that one more operation needs."""
    model = row.request
    marks = {f"{model.__module__}.{model.__name__}"}
    if row.is_job:  # words such as `status` and `result` stand for other things as well
        marks.add(repr(row.op))
    its_row = model.__module__.removeprefix("daemon.").replace(".", "/") + ".py"
    assert model.__name__ in sources[its_row]
    (its_body,) = {name for name, found in sources.items() if marks & found} - {its_row}
    assert its_body.startswith("procedures/") if row.is_job else its_body == "server/handlers.py"


def test_no_file_lists_the_jobs_a_second_time(sources: dict[str, set[str]]) -> None:
    jobs_named = {repr(row.op) for row in OPERATIONS.rows if row.is_job}
    lists = {name for name, found in sources.items() if len(found & jobs_named) > 2}
    assert lists == {"wire/operations/jobs.py"}
