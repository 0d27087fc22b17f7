"""Every word of the page stands in each language, and none stands in the code."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

import daemon.page
from daemon.domain.errors import FaultCode
from daemon.maintenance.catalogue import all_specs
from daemon.wire.operations.table import OPERATIONS

HERE = Path(daemon.page.__file__).parent
LANGUAGES = {file.stem: json.loads(file.read_text()) for file in (HERE / "words").glob("*.json")}
SCRIPTS = {file.name: file.read_text() for file in (HERE / "static").glob("*.js")}
USED = re.compile(r"""\bt\(\s*["']([\w.]+)["']""")
FACTS = re.compile(r"\{(\w+)\}")


def test_there_are_english_and_german() -> None:
    assert LANGUAGES.keys() >= {"en", "de"}


def test_all_languages_have_the_same_keys_and_facts() -> None:
    english = LANGUAGES["en"]
    for language, words in LANGUAGES.items():
        assert words.keys() == english.keys(), language
        for key, text in words.items():
            assert sorted(FACTS.findall(text)) == sorted(FACTS.findall(english[key])), (language, key)
            assert bool(text) == bool(english[key]), (language, key)


def test_each_word_that_a_script_asks_for_is_there() -> None:
    asked = {key for text in SCRIPTS.values() for key in USED.findall(text)}
    assert len(asked) > 40
    assert asked <= LANGUAGES["en"].keys()


@pytest.mark.parametrize("kind", list(FaultCode), ids=lambda kind: kind.wire_name)
def test_every_fault_has_its_cause_in_each_language_and_one_that_needs_a_person_its_cure(kind: FaultCode) -> None:
    for words in LANGUAGES.values():
        assert words[f"error.{kind.wire_name}"]
        assert words[f"cure.{kind.wire_name}"] or not kind.latched


def test_every_job_and_each_way_it_can_end_has_its_word_in_each_language() -> None:
    jobs = {f"op.{row.op}" for row in OPERATIONS.rows if row.outcomes}
    ends = {f"outcome.{outcome}" for outcome in OPERATIONS.outcomes}
    for words in LANGUAGES.values():
        assert jobs | ends <= words.keys()


_PART = re.compile(r"^(placement_at|bus_timeouts|bus_garbled|arrival|following|drive)_(\w+)$")


@pytest.mark.parametrize("watch", list(all_specs(["main"])), ids=lambda watch: watch.name)
def test_every_watch_is_named_and_has_its_cure_in_each_language(watch: Any) -> None:
    kind, part = match.groups() if (match := _PART.match(watch.name)) else (watch.name, "")
    for words in LANGUAGES.values():
        assert words[f"advice.{kind}"]
        assert ("{of}" in words[f"watch.{kind}"]) == bool(part)
        assert not watch.unit or watch.unit in ("px", "1/px") or words[f"unit.{watch.unit}"]
    if not part:
        assert LANGUAGES["en"][f"watch.{kind}"] == watch.what


@pytest.mark.parametrize("name", SCRIPTS, ids=str)
def test_no_script_makes_markup_of_a_text_or_code_of_a_string(name: str) -> None:
    forbidden = ("innerHTML", "outerHTML", "insertAdjacentHTML", "document.write", "eval(", "new Function", "srcdoc")
    assert [word for word in forbidden if word in SCRIPTS[name]] == []


def test_the_first_page_has_no_word_and_no_script_of_its_own() -> None:
    text = (HERE / "static" / "index.html").read_text()
    assert re.findall(r">([^<>\s][^<>]*)<", text.split("<body>")[1]) == []
    assert re.findall(r"<script(?![^>]*src=)", text) == []
    assert "style=" not in text
    assert " on" not in re.sub(r"<(meta|link)[^>]*>", "", text)
