"""Stored plans: versions stay, sameness makes none, approval is kept, and what was damaged is said."""

from __future__ import annotations

from pathlib import Path

import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.plan import Plan
from daemon.domain.point_test import Limits, PointTest
from daemon.storage.plan_store import PlanStore


def _plan(high: float = 5.0, name: str = "power", learned_from: tuple[str, ...] = ()) -> Plan:
    tests = (PointTest(point="TP1", net="GND", limits=Limits(high=high, unit="ohm")),)
    return Plan(name=name, board="demo", board_revision="r1", tests=tests, learned_from=learned_from)


@pytest.fixture
def store(tmp_path: Path) -> PlanStore:
    return PlanStore(tmp_path / "plans")


def test_each_change_is_a_new_version_and_the_old_one_stays(store: PlanStore) -> None:
    first, second = store.store(_plan(5.0), "ada"), store.store(_plan(2.0), "bob")
    assert (first.version, second.version) == (1, 2)
    assert store.get("power") == second
    assert store.get("power", 1) == first
    assert (first.hash, second.hash) == (_plan(5.0).hash, _plan(2.0).hash)


def test_a_plan_that_says_the_same_makes_no_new_version(store: PlanStore) -> None:
    assert store.store(_plan(), "ada") == store.store(_plan(), "bob")


def test_an_old_plan_that_comes_back_is_a_new_version(store: PlanStore) -> None:
    assert [store.store(_plan(high), "ada").version for high in (5.0, 2.0, 5.0)] == [1, 2, 3]


def test_learned_limits_are_used_only_when_a_person_has_approved_that_version(store: PlanStore) -> None:
    stored = store.store(_plan(learned_from=("run-1",)), "ada")
    with pytest.raises(Fault) as caught:
        stored.require_approved()
    assert caught.value.kind is FaultCode.PLAN_NOT_APPROVED
    approved = store.approve("power", None, "M. Weber")
    approved.require_approved()
    assert approved.approved is not None
    assert (approved.approved.by, approved.hash) == ("M. Weber", stored.hash)
    assert store.get("power") == approved
    store.store(_plan(2.0, learned_from=("run-2",)), "ada")
    with pytest.raises(Fault):
        store.get("power").require_approved()


def test_the_newest_version_of_each_plan_is_listed_by_name(store: PlanStore) -> None:
    for name, high in (("b", 1.0), ("a", 1.0), ("a", 2.0)):
        store.store(_plan(high, name), "ada")
    found, damaged = store.newest()
    assert [(one.plan.name, one.version) for one in found] == [("a", 2), ("b", 1)]
    assert damaged == []


@pytest.mark.parametrize(("name", "version"), [("other", None), ("power", 7), ("../power", None), ("", None)])
def test_a_plan_that_is_not_stored_is_refused_by_name(name: str, version: int | None, store: PlanStore) -> None:
    store.store(_plan(), "ada")
    with pytest.raises(Fault, match="not stored") as caught:
        store.get(name, version)
    assert caught.value.kind is FaultCode.UNKNOWN_PLAN


@pytest.mark.parametrize("edit", ['{"version": 1', "high", "empty"])
def test_a_file_that_was_changed_by_hand_is_not_used_and_hides_no_other(
    edit: str, store: PlanStore, tmp_path: Path
) -> None:
    store.store(_plan(), "ada")
    store.store(_plan(name="other"), "ada")
    file = tmp_path / "plans" / "power" / "0001.json"
    text = file.read_text()
    file.write_text({"high": text.replace("5.0", "50.0"), "empty": ""}.get(edit, edit))
    with pytest.raises(Fault, match="cannot be read"):
        store.get("power")
    found, damaged = store.newest()
    assert [one.plan.name for one in found] == ["other"]
    assert len(damaged) == 1


def test_no_plan_is_stored_where_none_ever_was(store: PlanStore) -> None:
    assert store.newest() == ([], [])
