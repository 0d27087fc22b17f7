"""The head's rotation is measured stop by stop on the cross, fitted, tried out; what does not hold is refused."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon.domain.errors import Fault, FaultCode
from daemon.domain.states import Event
from daemon.procedures.calibrate import rotation
from daemon.procedures.calibrate.head_angles import between, plan_angles
from daemon.procedures.calibrate.rotation import fit_or_refuse
from daemon.procedures.calibrate.rotation_run import MeasuredAngle
from daemon.procedures.registry import PROCEDURES
from daemon.storage.calibration_records import RotationRecord, Stop
from daemon.storage.calibration_resume import Partial
from drivers.errors import EnvelopeViolation
from tests.daemon.procedures.fake_station import Ran, World, a_board, begin, pose_map, run
from vision.head.model import CircleHead, FourierHead, Head

LOWEST_DEG = -219.5
"""The end of the axis' range and the room to come to a target from below."""

REQUEST = {"op": "calibrate", "what": "rotation", "angles": 12, "model": "fourier"}
TRUE_HEAD = FourierHead((20.0 + 5.0j, 3.0 - 8.0j, 14_900.0 - 700.0j, 12.0 + 9.0j))


def _world(folder: Path, head: Head = TRUE_HEAD, **changes: dict[str, Any]) -> World:
    changes.setdefault("gantry", {"press_um": 0.0})
    world = World(folder, a_board(("A", 10_000.0, 5_000.0)), changes).teach().with_map()
    world.true_head = head
    return world


@pytest.fixture
def world(tmp_path: Path) -> World:
    return _world(tmp_path)


async def _measure(world: World, request: dict[str, Any] | None = None, ran: Ran | None = None) -> Ran:
    return await run(world, PROCEDURES["calibrate"], REQUEST | (request or {}), ran)


async def _fault(world: World, request: dict[str, Any] | None = None, ran: Ran | None = None) -> Fault:
    with pytest.raises(Fault) as caught:
        await _measure(world, request, ran)
    return caught.value


def _record(world: World) -> RotationRecord:
    record = world.calibrations.records["rotation"]
    assert isinstance(record, RotationRecord)
    return record


def _landing_um(world: World, theta_deg: float) -> float:
    """Return how far the tip is from the cross after a jump by the head in force, but for what is constant."""
    head = world.geometry.head
    return math.hypot(*(world.true_head.tip_offset_um(theta_deg) - head.tip_offset_um(theta_deg)))


# --- what comes out -----------------------------------------------------------------------------------------------


async def test_the_head_in_force_is_the_true_one_at_angles_it_was_not_fitted_on(world: World) -> None:
    assert _landing_um(world, 45.0) > 30.0
    ran = await _measure(world, {"angles": 24})
    off = [_landing_um(world, theta) for theta in (10.0, 45.0, 150.0, 201.0, 290.0, 355.0)]
    constant = np.mean(off)
    assert np.ptp(off) < 25.0
    assert constant < 40.0
    told = ran.got.detail
    assert (ran.got.outcome, told["what"], told["angles"]) == ("calibrated", "rotation", 24)
    assert (told["outliers"], told["resumed"]) == ([], False)
    assert max(told["landings_um"]) < 20.0
    assert told["radius_um"] == pytest.approx(abs(14_900.0 - 700.0j), abs=40.0)
    assert told["closure_um"] == pytest.approx(0.0, abs=0.5)
    assert told["card_height_um"] == 0.0
    assert told["rms_um"] < 10.0


async def test_every_stop_is_where_the_head_stands_with_the_tip_on_the_cross(world: World) -> None:
    await _measure(world)
    record = _record(world)
    planned = plan_angles(12, None, LOWEST_DEG, 100.0)
    assert [s.theta_deg for s in record.stops] == planned
    for stop in record.stops:
        tip = np.array((stop.x_um, stop.y_um)) + world.true_head.tip_offset_um(stop.theta_deg)
        assert tip == pytest.approx(world.cross_um, abs=0.5)
    assert record.control_um == world.cross_um
    assert record.used == (True,) * 12
    assert [s.theta_deg for s in record.sightings] == planned


async def test_residuals_are_measured_minus_model(world: World) -> None:
    await _measure(world, {"model": "circle"})
    record = _record(world)
    assert record.kind == "circle"
    assert world.calibrations.head is not None
    found = [np.add((s.x_um, s.y_um), world.calibrations.head.tip_offset_um(s.theta_deg)) for s in record.stops]
    control = np.mean([f - r for f, r in zip(found, record.residuals_um, strict=True)], axis=0)
    for f, r in zip(found, record.residuals_um, strict=True):
        assert r == pytest.approx(tuple(f - control), abs=0.01)


async def test_before_and_after_are_landings_by_the_old_head_and_the_new(world: World) -> None:
    old = CircleHead(14_700.0, -2.0)
    world.with_head(old)
    await _measure(world, {"angles": 24})
    record = _record(world)
    tips = [old.tip_offset_um(s.theta_deg) - world.true_head.tip_offset_um(s.theta_deg) for s in record.stops]
    middle = np.mean(tips, axis=0)
    for one, tip in zip(record.before, tips, strict=True):
        assert (one.dx_um, one.dy_um) == pytest.approx(tuple(middle - tip), abs=1.0)
    assert [one.theta_deg for one in record.after] == between(plan_angles(24, None, LOWEST_DEG, 100.0), 8)
    assert max(math.hypot(one.dx_um, one.dy_um) for one in record.after) < 20.0
    assert record.total_error_um > 100.0


async def test_the_model_asked_for_is_the_one_that_is_fitted(world: World) -> None:
    for model in ("circle", "fourier", "array"):
        detail = (await _measure(world, {"model": model})).got.detail
        record = _record(world)
        assert record.kind == model
        assert detail["model"] == (f"fourier {record.order}" if model == "fourier" else model)


async def test_an_outlier_is_named_and_does_not_count(world: World) -> None:
    angle = plan_angles(24, None, LOWEST_DEG, 100.0)[5]
    near = angle - 360.0 if angle > 100.0 else angle

    def off() -> tuple[float, float]:
        there = abs(world.gantry.moves[-1][0].theta_deg % 360.0 - angle) < 0.01
        return (190.0, -120.0) if there else (0.0, 0.0)

    world.gantry.scatter_um = off
    detail = (await _measure(world, {"angles": 24})).got.detail
    assert detail["outliers"] == [pytest.approx(angle)]
    assert near < 0.0
    assert _record(world).used.count(False) == 1


# --- the map it stands on -----------------------------------------------------------------------------------------


async def test_without_a_map_one_is_acquired_on_the_cross_first(tmp_path: Path) -> None:
    world = World(tmp_path, a_board(("A", 10_000.0, 5_000.0)), {"gantry": {"press_um": 0.0}}).teach()
    await _measure(world)
    assert world.calibrations.records["map"].what == "map"
    assert len(_record(world).stops) == 12
    assert world.gantry.moves[0][0].theta_deg == plan_angles(12, None, LOWEST_DEG, 100.0)[0]


async def test_with_a_map_none_is_acquired(world: World) -> None:
    before = world.calibrations.mapped_at
    await _measure(world)
    assert world.calibrations.mapped_at == before
    assert len(world.gantry.moves) < 50


# --- refusals before anything moves -------------------------------------------------------------------------------


async def test_it_needs_a_cross_a_probe_and_homing(tmp_path: Path) -> None:
    bare = World(tmp_path / "a", a_board(("A", 10_000.0, 5_000.0)), {})
    ran = begin(REQUEST)
    assert "tip has not been taught" in (await _fault(bare, ran=ran)).message
    bare.teach().gantry.is_homed = False
    assert (await _fault(bare)).kind is FaultCode.NOT_HOMED
    bare.context.config = bare.config.model_copy(update={"control_point": None})
    fault = await _fault(bare)
    assert (fault.kind, fault.message) == (FaultCode.NOT_CALIBRATED, "the configuration has no [control_point]")
    assert (bare.gantry.moves, ran.events) == ([], [])


@pytest.mark.parametrize(("room_um", "good"), [(690.0, False), (710.0, True)])
@pytest.mark.parametrize(("axis", "end"), [("x", "minimum"), ("x", "maximum"), ("y", "minimum"), ("y", "maximum")])
async def test_there_must_be_room_round_every_stop(
    tmp_path: Path, axis: str, end: str, room_um: float, good: bool
) -> None:
    free = _world(tmp_path / "free", head=World(tmp_path / "n", a_board(), {}).true_head)
    at = [
        getattr(free.geometry.position_at(free.cross_um, a), f"{axis}_um")
        for a in plan_angles(12, None, LOWEST_DEG, 100.0)
    ]
    limit = max(at) + room_um if end == "maximum" else min(at) - room_um
    section = getattr(free.config.axes, axis).model_copy(update={end: limit})
    world = _world(tmp_path / "tight", free.true_head, axes={axis: section})
    if good:
        await _measure(world)
        return
    with pytest.raises(EnvelopeViolation):
        await _measure(world)
    assert world.gantry.moves == []


async def test_the_configured_range_of_the_axis_bounds_the_plan(tmp_path: Path) -> None:
    free = _world(tmp_path / "free")
    theta = free.config.axes.theta.model_copy(update={"minimum": -200.0, "maximum": 60.0})
    world = _world(tmp_path / "tight", axes={"theta": theta})
    await _measure(world)
    assert [s.theta_deg for s in _record(world).stops] == plan_angles(12, None, -199.5, 60.0)


# --- refusals of what was measured --------------------------------------------------------------------------------


def _measured(head: Head, noise_um: float = 0.0, count: int = 16) -> MeasuredAngle:
    rng = np.random.default_rng(4)
    stops = []
    for theta in np.linspace(140.0, 455.0, count):
        x, y = (30_000.0, 22_000.0) - head.tip_offset_um(float(theta)) + rng.normal(0.0, 1.0, 2) * noise_um
        stops.append(Stop(theta_deg=float(theta % 360.0), x_um=float(x), y_um=float(y), off_um=1.0, looks=1))
    return MeasuredAngle(stops=tuple(stops))


def test_a_head_that_predicts_what_was_left_out_is_taken_up_to_the_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    assert rotation.MAX_HOLDOUT_UM == 60.0
    measured = _measured(TRUE_HEAD, 20.0)
    fit = fit_or_refuse(measured, "circle")
    assert 10.0 < fit.holdout_rms_um < 60.0
    monkeypatch.setattr(rotation, "MAX_HOLDOUT_UM", fit.holdout_rms_um)
    fit_or_refuse(measured, "circle")
    monkeypatch.setattr(rotation, "MAX_HOLDOUT_UM", fit.holdout_rms_um - 0.001)
    with pytest.raises(Fault, match="are predicted to") as caught:
        fit_or_refuse(measured, "circle")
    assert caught.value.kind is FaultCode.CALIBRATION_FAILED
    assert caught.value.detail["holdout_rms_um"] == round(fit.holdout_rms_um, 1)


def test_stops_on_no_circle_are_no_head() -> None:
    still = tuple(
        Stop(theta_deg=float(t), x_um=30_000.0 + float(t), y_um=22_000.0, off_um=1.0, looks=1)
        for t in range(140, 360, 20)
    )
    with pytest.raises(Fault, match="the head cannot be fitted") as caught:
        fit_or_refuse(MeasuredAngle(stops=still), "auto")
    assert caught.value.kind is FaultCode.CALIBRATION_FAILED


def _kick(world: World, after: int, off_um: tuple[float, float]) -> None:
    """Let every move after that many end elsewhere, unseen by the drives."""
    world.gantry.scatter_um = lambda: off_um if len(world.gantry.moves) > after else (0.0, 0.0)


async def test_a_landing_may_miss_by_its_limit_and_no_more(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    assert rotation.MAX_LANDING_UM == 200.0
    await _measure(world)
    moves = len(world.gantry.moves) - len(_record(world).after)
    worst = 0.0
    for limit_um, good in ((math.inf, True), (None, True), (-0.001, False)):
        again = _world(world.calibrations.folder / str(limit_um))
        _kick(again, moves, (150.0, 0.0))
        monkeypatch.setattr(rotation, "MAX_LANDING_UM", 1e6 if limit_um == math.inf else worst + (limit_um or 0.0))
        if good:
            await _measure(again)
            worst = max(math.hypot(one.dx_um, one.dy_um) for one in _record(again).after)
            assert worst == pytest.approx(150.0, abs=10.0)
        else:
            fault = await _fault(again)
            assert "a landing by the new head model missed by" in fault.message
            assert "rotation" not in again.calibrations.records


async def test_landings_that_cannot_be_seen_are_no_proof(world: World) -> None:
    await _measure(world)
    looks = len(world.station.searches) - len(_record(world).after)
    blind = _world(world.calibrations.folder / "blind")

    def unseen(look: Any) -> Any:
        if len(blind.station.searches) > looks:
            blind.hidden = {"control point"}
            return replace(look, cross=blind.see_cross(look.tip, blind.station.searches[-1]))  # type: ignore[arg-type]
        return look

    blind.station.always = unseen
    fault = await _fault(blind)
    assert fault.message == "no landing by the new head model could be seen"
    assert "rotation" not in blind.calibrations.records


async def test_the_old_head_stays_and_the_next_run_measures_again_if_the_fit_is_refused(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as strict:
        strict.setattr(rotation, "MAX_HOLDOUT_UM", 0.0)
        assert "predicted" in (await _fault(world)).message
    assert world.calibrations.head is None
    assert Partial.read(world.calibrations.folder) is None
    assert (await _measure(world)).got.detail["resumed"] is False


async def test_a_run_whose_landings_were_refused_is_not_taken_up_again(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rotation, "MAX_LANDING_UM", 0.0)
    assert "missed by" in (await _fault(world)).message
    assert Partial.read(world.calibrations.folder) is None


async def test_a_run_that_did_not_close_is_not_taken_up_again(world: World) -> None:
    x_um, y_um = world.cross_um

    def move(look: Any) -> Any:
        if len(world.gantry.moves) == 13:  # the first angle and its walk nearer, then the others
            world.cross_um = (x_um + 90.0, y_um)
        return look

    world.station.always = move
    assert "from where it was at the start" in (await _fault(world)).message
    assert Partial.read(world.calibrations.folder) is None
    world.station.always = lambda look: look
    assert (await _measure(world)).got.detail["resumed"] is False


async def test_a_run_that_is_cut_off_before_its_last_angle_stays(world: World) -> None:
    def cut(look: Any) -> Any:
        if len(world.gantry.moves) > 6:
            raise Fault(FaultCode.CANCELLED)
        return look

    world.station.always = cut
    assert (await _fault(world)).kind is FaultCode.CANCELLED
    assert Partial.read(world.calibrations.folder) is not None


async def test_a_run_that_came_to_its_end_leaves_no_partial_one(world: World) -> None:
    ran = await _measure(world)
    assert Partial.read(world.calibrations.folder) is None
    assert ran.events[:3] == [Event.ACCEPTED, Event.SEEN, Event.ARRIVED]


async def test_the_height_of_the_prints_paper_is_measured_and_kept(tmp_path: Path) -> None:
    world = _world(tmp_path, gantry={"press_um": 200.0})
    world.height_um = lambda _x, _y: 40.0
    detail = (await _measure(world)).got.detail
    assert detail["card_height_um"] == pytest.approx(40.0, abs=0.5)
    record = _record(world)
    assert record.card_height_um == pytest.approx(40.0, abs=0.5)
    for stop in record.stops[1:]:
        tip = np.array((stop.x_um, stop.y_um)) + world.true_head.tip_offset_um(stop.theta_deg)
        assert tip == pytest.approx(world.cross_um, abs=1.5)


async def test_an_old_map_is_as_good_as_none(tmp_path: Path) -> None:
    world = _world(tmp_path)
    world.with_map(pose_map(), made_at="2020-01-01T00:00:00.000+00:00")
    await _measure(world)
    assert not str(world.calibrations.mapped_at).startswith("2020")
