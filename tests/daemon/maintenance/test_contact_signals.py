"""Points of runs become shares and readings, each counted once."""

from __future__ import annotations

import pytest

from daemon.domain.point_test import PointVerdict, Rung
from daemon.maintenance.contact_signals import POINTS_A_ROW, RUNGS, Contacts
from tests.bench.maintenance.histories import new_panel
from tests.daemon.domain.test_board_run import a_record


def test_each_point_counts_in_every_share_and_only_where_it_belongs() -> None:
    contacts = Contacts()
    for record in (
        a_record("A", PointVerdict.PASS_FIRST),
        a_record("B", PointVerdict.PASS_RECOVERED, recovered_by=Rung.LOOK),
        a_record("C", PointVerdict.CONTACT_NOT_MADE),
        a_record("D", PointVerdict.NOT_TESTED),
    ):
        contacts.add(record)
    numbers = contacts.take()
    assert numbers["first_touch_misses"] == [2.0, 3.0]
    assert numbers["contact_not_made"] == [1.0, 3.0]
    assert {name: numbers[name] for name in RUNGS} == {
        "recovered_by_look": [1.0, 3.0], "recovered_by_pump": [0.0, 3.0], "recovered_by_reference": [0.0, 3.0],
        "recovered_by_site": [0.0, 3.0],
    }  # fmt: skip
    assert contacts.take() == {}


def test_readings_of_the_reference_pad_are_taken_from_the_notes_of_moves() -> None:
    contacts = Contacts()
    contacts.add_step({"on": "reference pad", "ohm": 0.21, "good": True})
    contacts.add_step({"on": "reference pad", "ohm": None, "good": False})
    contacts.add_step({"x_um": 1.0})
    assert contacts.take() == {"reference_ohms": [0.21]}


def test_a_row_is_due_after_twenty_points() -> None:
    contacts = Contacts()
    for number in range(POINTS_A_ROW):
        assert not contacts.is_due
        contacts.add(a_record(str(number), PointVerdict.PASS_FIRST))
    assert contacts.is_due


@pytest.mark.parametrize("name", ["first_touch_misses", "contact_not_made", *RUNGS, "reference_ohms"])
def test_each_stream_has_a_watch(name: str) -> None:
    assert name in new_panel().specs
