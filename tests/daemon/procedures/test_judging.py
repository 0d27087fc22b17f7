"""A reading is held against a net only where the contact cannot be what was read."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from daemon.config.sections.touching import LadderSection
from daemon.domain.point_test import Limits, PointTest
from daemon.procedures.judging import Judged, Taken, accuses, agree, believed, judge, needs_proof, proved

LADDER = LadderSection()
INF = float("inf")


def _test(method: Any = "continuity", **limits: Any) -> PointTest:
    unit = {"voltage": "V", "diode": "V", "capacitance": "F"}.get(method, "ohm")
    return PointTest(point="A", method=method, limits=Limits(unit=unit, **limits) if limits else None)


def _ohm(value: float | None, **changes: Any) -> Taken:
    return Taken(value, value is None, "ohm", **changes)


@pytest.mark.parametrize(
    ("taken", "test", "judged"),
    [
        (_ohm(0.2), _test(), Judged.PASS),
        (_ohm(10.5), _test(), Judged.HIGH),
        (_ohm(None), _test(), Judged.OPEN),
        (_ohm(0.2, steady=False), _test(), Judged.UNSTEADY),
        (_ohm(900.0), _test("resistance", low=950.0, high=1050.0), Judged.LOW),
        (_ohm(1000.0), _test("resistance", low=950.0, high=1050.0), Judged.PASS),
        (_ohm(None), _test("resistance", low=1e6), Judged.PASS),
        (_ohm(50.0), _test("resistance", low=1e6), Judged.LOW),
        (_ohm(3e5), _test("resistance"), Judged.PASS),
        (_ohm(None), _test("resistance"), Judged.OPEN),
        (_ohm(0.2, said="pass"), _test(), Judged.PASS),
        (Taken(None, overload=False, unit="ohm", said="fail"), _test(), Judged.HIGH),
        (_ohm(None, said="open"), _test("resistance", low=1e6), Judged.OPEN),
        (Taken(None, overload=False, unit=None, said="pass"), _test("insert"), Judged.PASS),
        (_ohm(12.0, contact_ohm=12.0), _test("contact"), Judged.HIGH),
    ],
)
def test_a_reading_is_judged_by_the_limits_in_force(taken: Taken, test: PointTest, judged: Judged) -> None:
    assert judge(taken, test, LADDER) is judged


def test_contact_is_proved_by_the_second_wire_alone() -> None:
    assert proved(_ohm(None), LADDER) is None
    assert proved(_ohm(None, contact_ohm=0.23), LADDER) is True
    assert proved(_ohm(None, contact_ohm=250.0), LADDER) is False
    assert proved(_ohm(None, contact_ohm=INF), LADDER) is False


@pytest.mark.parametrize(
    ("taken", "test", "accused"),
    [
        (_ohm(None, contact_ohm=0.23), _test(), True),
        (_ohm(None, contact_ohm=INF), _test(), False),
        (_ohm(None), _test(), False),
        (_ohm(15.0, contact_ohm=0.23), _test(), True),
        (_ohm(15.0, contact_ohm=8.0), _test(), False),  # less the contact it may well be 7
        (_ohm(900.0, contact_ohm=0.2), _test("resistance", low=950.0, high=1050.0), True),
        (_ohm(900.0), _test("resistance", low=950.0, high=1050.0), True),  # contact can only add
        (_ohm(0.2, contact_ohm=0.2), _test(), False),
        (_ohm(15.0, steady=False, contact_ohm=0.2), _test(), False),
        (Taken(4.0, False, "V", contact_ohm=0.2), _test("voltage", low=4.5, high=5.5), True),
        (Taken(0.0, False, "V"), _test("voltage", low=4.5, high=5.5), False),
        (Taken(None, False, "ohm", said="fail", contact_ohm=0.2), _test(), True),
        (Taken(None, False, "ohm", said="fail"), _test(), False),
    ],
)
def test_only_what_cannot_be_the_contacts_own_accuses_the_net(taken: Taken, test: PointTest, accused: bool) -> None:
    assert accuses(taken, test, LADDER, judge(taken, test, LADDER)) is accused


@pytest.mark.parametrize(
    ("taken", "test"),
    [
        (_ohm(None), _test("resistance", low=1e6)),
        (Taken(0.0, False, "V"), _test("voltage", low=-1.0, high=1.0)),
        (Taken(3e-12, False, "F"), _test("capacitance")),
    ],
)
def test_a_pass_that_no_contact_would_give_as_well_is_none_before_contact_was_proved(
    taken: Taken, test: PointTest
) -> None:
    assert needs_proof(taken, test, judge(taken, test, LADDER))
    assert believed(taken, test, LADDER) is Judged.UNPROVED
    assert believed(replace(taken, contact_ohm=INF), test, LADDER) is Judged.UNPROVED
    assert believed(replace(taken, contact_ohm=0.2), test, LADDER) is Judged.PASS


@pytest.mark.parametrize(
    ("taken", "test"), [(_ohm(0.2), _test()), (Taken(5.0, False, "V"), _test("voltage", low=4.5, high=5.5))]
)
def test_a_pass_that_only_contact_can_give_proves_itself(taken: Taken, test: PointTest) -> None:
    assert not needs_proof(taken, test, Judged.PASS)
    assert believed(taken, test, LADDER) is Judged.PASS


def test_what_gave_no_pass_asks_for_a_proof() -> None:
    assert needs_proof(_ohm(None), _test(), Judged.OPEN)


def test_readings_agree_within_their_share_and_overloads_among_themselves() -> None:
    assert agree([100.0, 103.0, 98.0], 0.05, 0.05)
    assert not agree([100.0, 110.0, 98.0], 0.05, 0.05)
    assert agree([0.01, 0.05, 0.02], 0.05, 0.05)
    assert agree([INF, INF, INF], 0.05, 0.05)
    assert not agree([INF, 0.2, INF], 0.05, 0.05)
