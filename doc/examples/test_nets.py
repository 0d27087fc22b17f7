"""Nets of the demonstration board, tested with pytest.

pytest doc/examples/test_nets.py --reprobe-sim
pytest test_nets.py --reprobe-station tcp://station-1:5555 --reprobe-board board.json --reprobe-board-id 4711
"""

import pytest


def test_the_clock_is_wired(probe):
    assert probe("TP1").ohms < 2


@pytest.mark.reprobe_points("nets.toml")
def test_every_net_of_the_plan_is_whole(probe, point):
    assert probe(point)


@pytest.mark.reprobe_points(["TP6", "TP7"])
def test_the_needle_makes_contact(probe, point):
    assert probe(point, method="contact").passed
