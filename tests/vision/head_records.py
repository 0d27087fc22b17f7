"""Rotational records for tests: the thesis' own, rebuilt from the simulated station's residuals, and made-up ones."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
APPENDIX_D = ROOT.parent / "shared" / "thesis" / "appendix_d.csv"
RUNOUT = ROOT / "sim_hw" / "plant" / "data" / "head_runout.csv"
# What the residuals were taken against; see the head of that file. The centre is appendix D's.
CENTRE_UM, RADIUS_UM, PHASE_DEG = (364275.28, 313843.09), 14938.26, -3.054


def rebuilt_record() -> np.ndarray:
    """Return appendix D as (320, 3) theta_deg, x_um, y_um, from the run-out that the project keeps; exact to 0.1 um."""
    theta, dx, dy = np.loadtxt(RUNOUT, delimiter=",", skiprows=4, unpack=True)
    angle = np.radians(theta + PHASE_DEG)
    x = CENTRE_UM[0] - RADIUS_UM * np.cos(angle) - dx
    y = CENTRE_UM[1] - RADIUS_UM * np.sin(angle) - dy
    return np.column_stack([theta, x, y])


def allowed_angles(count: int) -> np.ndarray:
    """Return angles evenly over what the wiring allows."""
    way = np.arange(count) * 320.0 / count
    return np.where(way > 100.0, way + 40.0, way)


def made_up(
    offset: Callable[[np.ndarray], np.ndarray], theta: np.ndarray, control: complex = 1000.0 - 2000.0j
) -> np.ndarray:
    """Return the record (N, 3) a head with this complex offset(theta_deg) would give."""
    place = control - offset(theta)
    return np.column_stack([theta, place.real, place.imag])


def wobbly(theta_deg: np.ndarray) -> np.ndarray:
    """Return the offset, complex um, of a head with run-out in the second and third harmonic and backwards."""
    turn = np.exp(1j * np.radians(theta_deg))
    return 14000.0 * turn * np.exp(0.3j) + (40 - 25j) * turn**2 + (12 + 9j) * turn**3 + (20 + 5j) / turn
