"""The cycle bench's arithmetic: exchanges, legs, budgets."""

import json
import math

import pytest

from drivers.bus.od import OdAddressing, OdEntry, read_request, write_request
from tests.bench.cycle.budget import StationFacts, budget
from tests.bench.cycle.legs import AxisFacts, Follower, Leg, Way, needed_s, trapezoid_s
from tests.bench.cycle.line import CHECK_AT_REST, Exchange, by_name, exchanges, lit_frames, without_check_at_rest
from tests.bench.cycle.table import p95

TARGET, SPEED = OdEntry(0x607A, 0, 4, signed=True), OdEntry(0x6081, 0, 4)
CONTROL, POSITION = OdEntry(0x6040, 0, 2), OdEntry(0x6064, 0, 4, signed=True)
USUAL = OdAddressing("big", 1)
AXES = {1: AxisFacts("x", 10.0, 100.0, 1000.0, 2.0), 2: AxisFacts("y", 10.0, 100.0, 1000.0, 2.0),
        3: AxisFacts("z", 10.0, 100.0, 1000.0, 2.0)}  # fmt: skip
FACTS = StationFacts(0.06, 0.04, 0.02, 0.012, 1e-4, 0.03)


def told(slave: int, entry: OdEntry, value: int, at_s: float) -> Exchange:
    frame = bytes([slave, 0x2B]) + write_request(entry, value, USUAL).encode() + b"\0\0"
    return Exchange(at_s, at_s + 0.005, frame, frame[:13] + b"\0\0")


def position(slave: int, value: int, at_s: float) -> Exchange:
    ask = bytes([slave, 0x2B]) + read_request(POSITION, USUAL).encode()
    return Exchange(at_s, at_s + 0.005, ask + b"\0\0", ask + value.to_bytes(4, "little", signed=True) + b"\0\0")


def image(slave: int, value: int, at_s: float) -> Exchange:
    data = b"\x06\x37\x00\x01" + value.to_bytes(4, "big", signed=True) + bytes(4)
    return Exchange(at_s, at_s + 0.005, bytes([slave, 3]) + bytes(6), bytes([slave, 3, 12]) + data + b"\0\0")


def lamps(state: int, at_s: float) -> Exchange:
    return Exchange(at_s, at_s + 0.005, bytes([5, 0x0F, 0, 0, 0, 2, 1, state, 0, 0]), bytes(8))


def sent_to(slave: int, target: int, at_s: float) -> list[Exchange]:
    return [told(slave, TARGET, target, at_s), told(slave, CONTROL, 0x3F, at_s + 0.006)]


def test_what_comes_between_two_requests_is_the_reply_to_the_first() -> None:
    """It should join the parts of a reply, and keep a request that nobody answered."""
    lines = [[1.0, "sent", "0103"], [1.1, "received", "01"], [1.2, "received", "03"], [2.0, "sent", "0203"]]
    first, second = exchanges(map(json.dumps, lines))
    assert (first.sent_s, first.done_s, first.reply, first.size) == (1.0, 1.2, b"\x01\x03", 4)
    assert (second.slave, second.done_s, second.reply) == (2, 2.0, b"")


def test_requests_are_counted_by_what_they_ask() -> None:
    """It should tell reading an object from writing it, and know the image and the lamps."""
    part = [told(1, TARGET, 5, 0.0), told(2, TARGET, 5, 0.1), position(1, 7, 0.2), image(1, 7, 0.3), lamps(1, 0.4)]
    counts = {"write target": 2, "read position": 1, "read image": 1, "switch lamps": 1}
    assert dict(by_name(part)) == counts


def test_a_check_at_rest_that_ends_beside_a_job_is_not_the_jobs() -> None:
    """It should leave out each object once, in the check's order, and keep what the job asks of the same drive."""
    check = [position(1, 7, 0.1 * n) for n in range(len(CHECK_AT_REST))]
    check = [
        Exchange(e.sent_s, e.done_s, e.request[:6] + index.to_bytes(2, "big") + e.request[8:], e.reply)
        for e, index in zip(check, CHECK_AT_REST, strict=True)
    ]
    job = [position(1, 7, 5.0), image(1, 7, 5.1), told(1, TARGET, 9, 5.2), position(2, 7, 5.3)]
    mixed = [*check[:4], *job[1:], *check[4:], job[0]]
    assert without_check_at_rest(mixed) == [*job[1:], job[0]]


def test_values_are_read_with_their_sign() -> None:
    """It should take them from the request where they are written, from the reply where they are read."""
    for exchange in (told(1, TARGET, -70_000, 0.0), position(1, -70_000, 0.0)):
        assert exchange.object is not None
        assert exchange.object.value == -70_000


@pytest.mark.parametrize(("distance", "seconds"), [(0.0, 0.0), (2.5, 0.1), (-10.0, 0.2), (110.0, 1.2)])
def test_a_trapezoid_without_a_flat_top_is_a_triangle(distance: float, seconds: float) -> None:
    """It should reach full speed at 10 units, with 100 units/s and 1000 units/s2, and have no sign."""
    assert trapezoid_s(distance, 100.0, 1000.0) == pytest.approx(seconds)


def test_axes_that_start_together_are_one_leg_and_z_is_a_leg_of_its_own() -> None:
    """It should know where each began, by the object or by the image, and at which speed it goes."""
    follower = Follower(AXES)
    follower.follow([position(1, 100, 0.0), image(2, -50, 0.0), image(3, 0, 0.0)])
    follower.follow([*sent_to(1, 200, 1.0), *sent_to(2, 0, 1.02), told(3, SPEED, 25, 1.5), *sent_to(3, 30, 2.0)])
    across, down = follower.legs
    assert across.ways == {"x": Way(10.0, 20.0, 100.0, 1000.0), "y": Way(-5.0, 0.0, 100.0, 1000.0)}
    assert down.ways == {"z": Way(0.0, 3.0, 50.0, 1000.0)}
    assert across.seconds == pytest.approx(0.2)


def test_a_set_point_that_is_told_twice_is_one_leg() -> None:
    """It should take the rising edge of bit 4 only: the line may repeat a write."""
    follower = Follower(AXES)
    follower.follow([image(1, 0, 0.0), *sent_to(1, 100, 1.0), told(1, CONTROL, 0x3F, 1.1)])
    assert len(follower.legs) == 1
    follower.follow([told(1, CONTROL, 0x0F, 3.0), *sent_to(1, 0, 4.0)])
    assert [leg.ways["x"].end for leg in follower.legs] == [10.0, 0.0]


def leg(**ways: tuple[float, float]) -> Leg:
    return Leg(0.0, {name: Way(start, end, 100.0, 1000.0) for name, (start, end) in ways.items()})


def test_of_a_hop_only_the_way_across_and_the_difference_in_height_are_needed() -> None:
    """It should take the retract, the way to one side and the way down together; a stroke alone stays as it is."""
    hop = [leg(z=(0.0, 40.0)), leg(x=(0.0, -10.0)), leg(x=(-10.0, 2.5), y=(0.0, 0.4)), leg(z=(40.0, 5.0)),
           leg(z=(5.0, 2.5))]  # fmt: skip
    assert needed_s(hop) == pytest.approx(trapezoid_s(2.5, 100, 1000) + trapezoid_s(2.5, 100, 1000))
    stroke = [leg(z=(10.0, 0.0)), leg(z=(0.0, 10.0))]
    assert needed_s(stroke) == pytest.approx(sum(part.seconds for part in stroke))
    assert needed_s([*stroke, *hop, *hop]) == pytest.approx(needed_s(stroke) + 2 * needed_s(hop))


def test_a_lamp_that_is_told_twice_makes_one_frame_and_darkness_none() -> None:
    """It should count the changes to another lit state."""
    assert lit_frames([lamps(1, 0.0), lamps(2, 1.0), lamps(1, 2.0), lamps(1, 3.0), lamps(2, 4.0), lamps(0, 5.0)]) == 4


def test_a_budget_adds_up_to_what_was_measured() -> None:
    """It should name every part, and count the line's bytes only while nothing moves."""
    part = [image(1, 0, 0.0), *sent_to(1, 100, 0.02), image(1, 50, 0.1), lamps(1, 0.5), lamps(2, 0.6)]
    follower = Follower(AXES)
    follower.follow(part)
    timing = {"move": {"motion": 300.0, "total": 320.0}, "look": {"light": 90.0, "exposure": 100.0, "total": 400.0}}
    told_ = budget({**timing, "look": {**timing["look"], "software": 200.0}}, part, follower.legs, FACTS)
    assert told_.measured_s == pytest.approx(0.72)
    assert math.isclose(told_.floor_s + sum(told_.rest.values()), told_.measured_s)
    assert told_.floor["moves"] == pytest.approx(0.2)
    assert told_.floor["steady"] == pytest.approx(0.06 + 0.04)
    assert told_.floor["exposure"] == pytest.approx(2 * 0.032)
    moving = [exchange for exchange in part if 0.027 < exchange.sent_s < 0.226]
    assert told_.floor["bytes"] == pytest.approx(1e-4 * (told_.size - sum(exchange.size for exchange in moving)))
    assert (told_.requests, told_.frames) == (6, 2)
    assert told_.rest["camera"] == pytest.approx(0.036)


def test_a_correction_that_need_not_move_has_a_budget() -> None:
    """It should count no settling of a head that stood still."""
    timing = {"look": {"bus": 50.0, "light": 40.0, "exposure": 32.0, "software": 10.0, "total": 132.0}}
    part = [lamps(1, 0.0), lamps(2, 0.1)]
    told_ = budget(timing, part, [], FACTS)
    assert told_.floor["moves"] == 0.0
    assert told_.floor["steady"] == pytest.approx(2 * FACTS.light_settles_s)
    assert told_.measured_s == pytest.approx(0.132)


def test_the_95th_of_a_hundred_is_told() -> None:
    """It should take a value that was measured, and the largest of a few."""
    assert p95(list(range(1, 101))) == 96
    assert p95([3.0, 1.0]) == 3.0
