"""How far below a target X and Y turn back, by the play that was measured."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime, timedelta
from types import MappingProxyType

import pytest

from daemon.config.sections.motion import GantrySection
from daemon.station.approach import approach_of
from daemon.storage.calibration_in_force import InForce
from daemon.storage.calibration_records import AxisBacklash, BacklashRecord
from drivers.gantry import Approach

GANTRY = GantrySection(safe_z_um=12000.0, work_z_um=5200.0, touch_z_um=5000.0, approach_um=200.0, approach_deg=0.5)
AS_CONFIGURED = Approach(200.0, 200.0, 0.5)
DAYS = 30.0


def _play(um: float, sigma_um: float) -> AxisBacklash:
    return AxisBacklash(from_below_um=(0.0,), from_above_um=(um,), backlash_um=um, sigma_um=sigma_um)


def _measured(x: AxisBacklash, y: AxisBacklash, days_ago: float = 1.0) -> InForce:
    made_at = (datetime.now(UTC) - timedelta(days=days_ago)).isoformat()
    record = BacklashRecord.model_construct(what="backlash", made_at=made_at, x=x, y=y, approach_um=200.0)
    return replace(InForce("station-1"), records=MappingProxyType({"backlash": record}))


def test_where_no_play_was_measured_it_is_as_configured() -> None:
    assert approach_of(GANTRY, InForce("station-1"), DAYS) == AS_CONFIGURED


def test_it_is_longer_than_any_play_that_the_measured_one_leaves_possible() -> None:
    approach = approach_of(GANTRY, _measured(_play(15.0, 3.0), _play(-40.0, 3.0)), DAYS)
    assert 15.0 + 3 * 3.0 < approach.x_um < 100.0
    assert 40.0 + 3 * 3.0 < approach.y_um < 200.0
    assert approach.theta_deg == 0.5, "nobody measures the play of theta"


def test_it_is_never_longer_than_configured() -> None:
    assert approach_of(GANTRY, _measured(_play(150.0, 3.0), _play(500.0, 3.0)), DAYS) == AS_CONFIGURED


def test_an_axis_with_hardly_any_play_needs_none() -> None:
    approach = approach_of(GANTRY, _measured(_play(1.0, 1.0), _play(1.0, 2.0)), DAYS)
    assert approach.x_um == 0.0
    assert approach.y_um > 7.0, "nobody knows that it has none"


def test_a_time_without_a_zone_is_taken_as_utc() -> None:
    """As everywhere: a record of an old station or by hand must not keep the head from moving."""
    told = _measured(_play(1.0, 1.0), _play(1.0, 1.0))
    record = told.records["backlash"]
    naive = record.model_copy(update={"made_at": record.made_at.removesuffix("+00:00")})
    assert approach_of(GANTRY, replace(told, records=MappingProxyType({"backlash": naive})), DAYS).x_um == 0.0


@pytest.mark.parametrize("days_ago", [31.0, 400.0])
def test_what_was_measured_too_long_ago_counts_no_longer(days_ago: float) -> None:
    assert approach_of(GANTRY, _measured(_play(1.0, 1.0), _play(1.0, 1.0), days_ago), DAYS) == AS_CONFIGURED
