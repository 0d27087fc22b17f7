"""What a station says of itself is read or refused: nothing it says may stop who stores for all others."""

from __future__ import annotations

import json

import pytest

from daemon.fleet.batch import Batch, Nonsense
from daemon.fleet.collector import read_state
from daemon.fleet.database import plain_text


@pytest.mark.parametrize(
    "said",
    [
        {"alerts": 5}, {"alerts": True}, {"alerts": {"a": 1}}, {"alerts": "low"}, {"alerts": ["low", 7]},
        {"state": "\ud800"}, {"alerts": ["\ud800"]}, {"\udfff": 1}, {"fault": "a\0b"}, [], 7, None,
    ],
)  # fmt: skip
def test_a_state_that_no_table_can_hold_is_refused(said: object) -> None:
    with pytest.raises(Nonsense):
        read_state(json.dumps(said).encode())


@pytest.mark.parametrize(
    "said", [{}, {"alerts": None}, {"alerts": ["wear", "\u20ac"], "online": True, "state": "IDLE"}]
)
def test_any_other_state_is_taken_as_it_is(said: dict[str, object]) -> None:
    state, text = read_state(json.dumps(said).encode())
    assert state == json.loads(text) == said


@pytest.mark.parametrize("version", ["\0", "\ud800", 7, None])
def test_why_a_batch_is_refused_can_be_written_down_whatever_it_said(version: object) -> None:
    with pytest.raises(Nonsense) as refused:
        Batch.of(json.dumps({"v": version}).encode())
    text = plain_text(str(refused.value))
    assert "\0" not in text
    assert text.encode().decode() == text
