"""The head of the simulated station is the thesis' own: its record comes back out of it."""

import numpy as np
import pytest

from sim_hw.plant.runout import TIP_RADIUS_UM, runout_um, tip_offset_um

ANGLES = [theta for theta in range(360) if theta != 90 and not 101 <= theta <= 139]


def offsets() -> np.ndarray:
    return np.array([tip_offset_um(float(theta)) for theta in ANGLES])


def test_radial_rms_against_the_circle_is_the_thesis_42_um() -> None:
    points = offsets()
    design = np.column_stack([2.0 * points, np.ones(len(points))])
    x, y, constant = np.linalg.lstsq(design, (points**2).sum(axis=1), rcond=None)[0]
    radius = np.sqrt(constant + x * x + y * y)
    radial = np.hypot(points[:, 0] - x, points[:, 1] - y) - radius
    assert radius == pytest.approx(14938.2, abs=0.2)
    assert np.sqrt(np.mean(radial**2)) == pytest.approx(42.3, abs=0.1)


def test_rigid_rotation_fits_to_117_um_only() -> None:
    points, angle = offsets(), np.radians(ANGLES)
    zero, one = np.zeros(len(angle)), np.ones(len(angle))
    rows_x = np.column_stack([np.cos(angle), -np.sin(angle), one, zero])
    rows_y = np.column_stack([np.sin(angle), np.cos(angle), zero, one])
    design, wanted = np.vstack([rows_x, rows_y]), np.concatenate([points[:, 0], points[:, 1]])
    residual = (design @ np.linalg.lstsq(design, wanted, rcond=None)[0] - wanted).reshape(2, -1)
    distance = np.hypot(*residual)
    assert np.sqrt(np.mean(distance**2)) == pytest.approx(116.8, abs=0.1)
    assert distance.max() == pytest.approx(363.3, abs=0.5)


def test_the_record_is_reproduced_to_its_own_micrometre() -> None:
    # Appendix D, theta = 0 and 3: the axes stood here while the tip stood on the control point.
    for theta, recorded in ((0.0, (349409.0, 314618.0)), (3.0, (349362.0, 313780.0))):
        x_um, y_um = tip_offset_um(theta)
        assert (364275.28 - x_um, 313843.09 - y_um) == pytest.approx(recorded, abs=0.1)


def test_runout_is_periodic_and_bridges_the_forbidden_gap() -> None:
    assert runout_um(-10.0) == pytest.approx(runout_um(350.0))
    assert runout_um(360.0) == pytest.approx(runout_um(0.0))
    (x100, y100), (x140, y140), (x120, y120) = runout_um(100.0), runout_um(140.0), runout_um(120.0)
    assert (x120, y120) == pytest.approx(((x100 + x140) / 2.0, (y100 + y140) / 2.0))


def test_scale_zero_is_a_perfect_head() -> None:
    assert np.hypot(*tip_offset_um(77.0, runout_scale=0.0)) == pytest.approx(TIP_RADIUS_UM)
