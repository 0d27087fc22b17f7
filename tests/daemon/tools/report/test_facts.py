"""What is computed for a page is right where the truth is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daemon.tools.report.alignment import placed_um
from daemon.tools.report.mapping import Mapped
from daemon.tools.report.mapping import drift as map_drift
from daemon.tools.report.rotation_facts import FORBIDDEN_DEG, Rotation, allowed_stretches, drift, linearity
from daemon.tools.report.surface import slopes_um_per_100_mm
from tests.daemon.tools.report.synthetic import (
    CAMERA_UM_PER_PX,
    VIEW_DEG,
    alignment_record,
    map_record,
    rotation_record,
    surface_record,
)
from vision.head.model import CircleHead, head_to_dict, tip_offsets_um


def test_a_stop_is_split_into_outwards_and_ahead() -> None:
    facts = Rotation(rotation_record(outlier=False))
    theta = np.array([10.0, 200.0])
    turn = np.radians(theta + facts.phase_deg)
    out, ahead = np.column_stack([np.cos(turn), np.sin(turn)]), np.column_stack([-np.sin(turn), np.cos(turn)])
    polar = facts.polar(theta, facts.ideal_um(theta) + 30.0 * out - 12.0 * ahead)
    assert polar.radial_um == pytest.approx([30.0, 30.0], abs=0.1)
    assert polar.tangential_um == pytest.approx([-12.0, -12.0], abs=0.1)


def test_a_rigid_rotation_leaves_what_the_real_heads_record_says() -> None:
    """Appendix D: one radius and one angle leave 117 um rms."""
    assert Rotation(rotation_record(2, outlier=False)).rigid_rms_um == pytest.approx(117.0, abs=8.0)


def test_the_models_course_goes_through_the_stops_up_to_what_it_left() -> None:
    record = rotation_record()
    facts = Rotation(record)
    off = facts.stops_um - facts.modelled_um(facts.theta_deg) - facts.left_um
    assert np.abs(off).max() < 1e-6


def test_no_curve_enters_the_forbidden_angles() -> None:
    below, above = allowed_stretches()
    assert below.min() == 0.0
    assert below.max() == FORBIDDEN_DEG[0]
    assert above.min() == FORBIDDEN_DEG[1]
    assert above.max() == 360.0


def test_the_angle_with_most_sightings_shows_the_linearity() -> None:
    found = linearity(rotation_record())
    assert found is not None
    assert found.theta_deg == 0.0
    assert len(found.image_px) == 8
    assert len(found.others_px) == 21
    assert found.um_per_px == pytest.approx(CAMERA_UM_PER_PX, rel=0.2)
    assert np.abs(found.residual_um).max() < 5.0


def test_with_few_sightings_at_each_angle_all_are_taken_together() -> None:
    record = rotation_record()
    thin = record.model_copy(update={"sightings": record.sightings[7:]})
    found = linearity(thin)
    assert found is not None
    assert found.theta_deg is None
    assert len(found.image_px) == 22
    assert linearity(record.model_copy(update={"sightings": record.sightings[:2]})) is None


def test_a_sighting_at_an_angle_without_a_stop_is_not_used() -> None:
    record = rotation_record()
    lost = [seen.model_copy(update={"theta_deg": 77.7}) for seen in record.sightings]
    assert linearity(record.model_copy(update={"sightings": tuple(lost)})) is None


def test_drift_of_two_circles_is_radius_outwards_and_phase_ahead() -> None:
    record = rotation_record(outlier=False)
    old, new = CircleHead(15_000.0, 10.0), CircleHead(15_020.0, 10.0 + np.degrees(30.0 / 15_000.0))
    found = drift(
        Rotation(record.model_copy(update={"head": head_to_dict(new)})),
        Rotation(record.model_copy(update={"head": head_to_dict(old)})),
    )
    for theta, radial, tangential, length in found.stretches:
        assert radial == pytest.approx(np.full(len(theta), 20.0), abs=0.1)
        assert tangential == pytest.approx(np.full(len(theta), 30.0), abs=0.1)
        apart = tip_offsets_um(new, theta) - tip_offsets_um(old, theta)
        assert length == pytest.approx(np.linalg.norm(apart, axis=1))
    assert found.rms_um == pytest.approx(np.hypot(20.0, 30.0), abs=0.1)
    assert found.max_um >= found.rms_um


def test_the_worth_of_a_pixel_and_the_view_are_the_cameras() -> None:
    mapped = Mapped.of(map_record(noise_um=0.0))
    across, along = mapped.scales_um_per_px()
    assert across == pytest.approx(CAMERA_UM_PER_PX, rel=2e-3)
    assert along == pytest.approx(CAMERA_UM_PER_PX / np.cos(np.radians(VIEW_DEG)), rel=2e-3)
    assert mapped.view_deg() == pytest.approx(VIEW_DEG, abs=0.3)


def test_the_maps_residuals_on_the_page_are_those_of_the_fit() -> None:
    mapped = Mapped.of(map_record())
    left = mapped.residuals_um()
    rms = float(np.sqrt(((left - left.mean(axis=0)) ** 2).sum(axis=1).mean()))
    assert rms == pytest.approx(mapped.pose_map.residual_um, rel=0.02)


def test_a_map_that_was_stretched_drifts_in_proportion_to_the_distance() -> None:
    found = map_drift(Mapped.of(map_record(noise_um=0.0, stretch=1.02)), Mapped.of(map_record(noise_um=0.0)))
    radius = Mapped.of(map_record(noise_um=0.0, stretch=1.02)).pose_map.radius_um
    assert found.max_um == pytest.approx(0.02 * radius, rel=0.05)
    assert found.rms_um < found.max_um


@pytest.mark.parametrize("wider", ["now", "before"])
def test_maps_are_compared_where_both_were_fitted(wider: str) -> None:
    """One that was made near the tip alone says nothing of what is far out: that is no drift."""
    now, before = Mapped.of(map_record(noise_um=0.0, stretch=1.02)), Mapped.of(map_record(noise_um=0.0))
    near_um = map_drift(now, before).max_um
    if wider == "now":
        now = replace(now, pose_map=replace(now.pose_map, radius_um=3_000.0))
    else:
        before = replace(before, pose_map=replace(before.pose_map, radius_um=3_000.0))
    assert map_drift(now, before).max_um == pytest.approx(near_um, rel=0.05)


def test_the_planes_slopes_are_those_it_was_made_with() -> None:
    rise_x, rise_y = slopes_um_per_100_mm(surface_record())
    assert rise_x == pytest.approx(18.0 / 0.65, abs=5.0)
    assert rise_y == pytest.approx(-9.0 / 0.65, abs=5.0)


def test_a_fiducial_is_placed_where_it_was_seen_up_to_its_residual() -> None:
    record = alignment_record()
    board = np.array([fiducial.board_um for fiducial in record.fiducials])
    seen = np.array([fiducial.robot_um for fiducial in record.fiducials])
    left = np.array([fiducial.residual_um for fiducial in record.fiducials])
    assert placed_um(record, board) + left == pytest.approx(seen, abs=1e-3)
