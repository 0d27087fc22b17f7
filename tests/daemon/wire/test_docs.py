"""What is written about the wire is what is spoken."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from pydantic import ValidationError
from typer.testing import CliRunner

from daemon.cli.app import app
from daemon.config.sections.service import ApiSection
from daemon.domain.errors import FaultCode
from daemon.domain.results import JobResult
from daemon.maintenance.alerts import Alert
from daemon.wire.docs import examples as wire_examples
from daemon.wire.docs.page import page
from daemon.wire.docs.schema import schemas, write
from daemon.wire.events import TOPICS, AlertFacts, ResultEvent
from daemon.wire.example_parts import ALERT, RESULT
from daemon.wire.operations.row import Operation
from daemon.wire.operations.table import OPERATIONS
from daemon.wire.replies import Refusal
from daemon.wire.requests import VERSIONS, Request

DOC = Path(__file__).parents[3] / "doc"


def test_the_committed_page_and_schemas_are_what_the_code_makes(tmp_path: Path) -> None:
    """Where this fails: `reprobe schema --out doc`, and look at the difference: the wire has changed."""
    made = {path.relative_to(tmp_path): path.read_text() for path in write(tmp_path, ApiSection)}
    kept = {path.relative_to(DOC): path.read_text() for path in (DOC / "wire.md", *(DOC / "schema").iterdir())}
    assert made.keys() == kept.keys()
    for name, text in made.items():
        assert kept[name] == text, f"{name} is out of date: run `reprobe schema --out doc`"


def test_every_topic_has_an_example() -> None:
    assert TOPICS.keys() == wire_examples.EVENTS.keys()


@pytest.mark.parametrize("row", OPERATIONS.rows, ids=lambda row: row.op)
def test_an_example_request_is_taken_and_its_reply_is_whole(row: Operation) -> None:
    assert OPERATIONS.parse(wire_examples.request(row)).op == row.op
    example = wire_examples.reply(row)
    reply = row.reply.model_validate(example)
    said = json.loads(reply.to_json())
    assert example.keys() <= said.keys()
    assert said["v"] in VERSIONS


@pytest.mark.parametrize("topic", TOPICS)
def test_an_example_event_is_whole(topic: str) -> None:
    example = wire_examples.event(topic)
    assert json.loads(TOPICS[topic].model_validate(example).model_dump_json()).keys() >= example.keys()


def test_a_refusal_carries_its_version_code_and_advice() -> None:
    said = json.loads(Refusal.model_validate(wire_examples.REFUSAL).to_json())
    assert (said["v"], said["ok"], said["error"]["code"]) == (1, False, FaultCode.BUSY.code)
    assert said["error"]["advice"]


def test_every_error_is_on_the_page_with_cause_and_cure() -> None:
    text = page(ApiSection)
    for kind in FaultCode:
        assert f"| {kind.code} | `{kind.wire_name}` | {kind.value.cause} | {kind.value.advice} |" in text


def test_every_link_of_the_page_leads_somewhere() -> None:
    text = page(ApiSection)
    anchors = {title.lower().replace(" ", "-") for title in re.findall(r"^#+ (.*)$", text, flags=re.MULTILINE)}
    links = set(re.findall(r"\]\(#([\w-]+)\)", text))
    assert links
    assert links <= anchors


def test_a_client_of_today_understands_a_daemon_that_says_more() -> None:
    more = {"mood": "fine"}
    assert JobResult.model_validate(RESULT | more)
    for row in OPERATIONS.rows:
        assert row.reply.model_validate(wire_examples.reply(row) | more)
    assert "additionalProperties" not in {key for d in schemas()["reply"]["$defs"].values() for key in d}


def test_the_daemon_itself_says_nothing_that_is_not_written() -> None:
    for topic in ("state", "result", "alert", "heartbeat", "progress"):
        with pytest.raises(ValidationError):
            TOPICS[topic].model_validate({**wire_examples.event(topic), "mood": "fine"})


def test_a_result_is_the_same_journalled_answered_and_published() -> None:
    assert set(JobResult.model_fields) <= set(ResultEvent.model_fields)


def test_an_alert_of_maintenance_is_what_the_wire_says_it_is() -> None:
    alert = Alert.from_dict(ALERT)
    assert set(alert.to_dict()) == set(AlertFacts.model_fields)
    body = json.loads(json.dumps(alert.body("raised")))
    assert TOPICS["alert"].model_validate(wire_examples.event("alert") | body)


def test_what_every_request_may_carry_is_no_secret() -> None:
    assert set(Request.model_fields) == {"v", "tag", "by", "deadline_ms"}


def test_the_command_prints_the_schemas_or_writes_all(tmp_path: Path) -> None:
    printed = CliRunner().invoke(app, ["schema"])
    assert json.loads(printed.stdout) == json.loads(json.dumps(schemas()))
    written = CliRunner().invoke(app, ["schema", "--out", str(tmp_path)])
    assert written.exit_code == 0
    assert (tmp_path / "wire.md").read_text() == page(ApiSection)
