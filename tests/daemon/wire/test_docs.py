"""What is written about the wire is what is spoken."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from pydantic import ValidationError
from typer.testing import CliRunner

from daemon.cli.app import app
from daemon.config.model import ApiSection
from daemon.domain.errors import FaultCode
from daemon.domain.results import JobResult
from daemon.domain.roles import LEAST_ROLE, may
from daemon.maintenance.alerts import Alert
from daemon.wire.docs import examples as wire_examples
from daemon.wire.docs.page import page, requests
from daemon.wire.docs.schema import schemas, write
from daemon.wire.events import TOPICS, AlertFacts, ResultEvent
from daemon.wire.replies import REPLIES, Refusal
from daemon.wire.requests import OPS, VERSIONS, Request, parse_request

DOC = Path(__file__).parents[3] / "doc"


def test_the_committed_page_and_schemas_are_what_the_code_makes(tmp_path: Path) -> None:
    """Where this fails: `reprobe schema --out doc`, and look at the difference: the wire has changed."""
    made = {path.relative_to(tmp_path): path.read_text() for path in write(tmp_path, ApiSection)}
    kept = {path.relative_to(DOC): path.read_text() for path in (DOC / "wire.md", *(DOC / "schema").iterdir())}
    assert made.keys() == kept.keys()
    for name, text in made.items():
        assert kept[name] == text, f"{name} is out of date: run `reprobe schema --out doc`"


def test_every_operation_has_a_request_a_reply_a_role_and_examples() -> None:
    assert set(OPS) == requests().keys() == REPLIES.keys() == LEAST_ROLE.keys()
    assert set(OPS) == wire_examples.REQUESTS.keys() == wire_examples.REPLIES.keys()
    assert TOPICS.keys() == wire_examples.EVENTS.keys()


@pytest.mark.parametrize("op", OPS)
def test_an_example_request_is_taken_and_its_reply_is_whole(op: str) -> None:
    assert parse_request(wire_examples.request(op)).op == op
    example = wire_examples.reply(op)
    reply = REPLIES[op].model_validate(example)
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
    assert JobResult.model_validate(wire_examples.RESULT | more)
    for op in OPS:
        assert REPLIES[op].model_validate(wire_examples.reply(op) | more)
    assert "additionalProperties" not in {key for d in schemas()["reply"]["$defs"].values() for key in d}


def test_the_daemon_itself_says_nothing_that_is_not_written() -> None:
    for topic in ("state", "result", "alert", "heartbeat", "progress"):
        with pytest.raises(ValidationError):
            TOPICS[topic].model_validate({**wire_examples.event(topic), "mood": "fine"})


def test_a_result_is_the_same_journalled_answered_and_published() -> None:
    assert set(JobResult.model_fields) <= set(ResultEvent.model_fields)


def test_an_alert_of_maintenance_is_what_the_wire_says_it_is() -> None:
    alert = Alert.from_dict(wire_examples.ALERT)
    assert set(alert.to_dict()) == set(AlertFacts.model_fields)
    body = json.loads(json.dumps(alert.body("raised")))
    assert TOPICS["alert"].model_validate(wire_examples.event("alert") | body)


def test_each_role_may_all_that_the_one_before_it_may() -> None:
    for op in OPS:
        allowed = [may(role, op) for role in ("observe", "operate", "maintain")]
        assert allowed == sorted(allowed)
        assert allowed[-1]
    assert [op for op in OPS if not may("operate", op)] == ["calibrate", "home", "reset", "acknowledge"]
    assert not may("operate", "an operation nobody has listed")


def test_what_every_request_may_carry_is_no_secret() -> None:
    assert set(Request.model_fields) == {"v", "deadline_ms"}


def test_the_command_prints_the_schemas_or_writes_all(tmp_path: Path) -> None:
    printed = CliRunner().invoke(app, ["schema"])
    assert json.loads(printed.stdout) == json.loads(json.dumps(schemas()))
    written = CliRunner().invoke(app, ["schema", "--out", str(tmp_path)])
    assert written.exit_code == 0
    assert (tmp_path / "wire.md").read_text() == page(ApiSection)
