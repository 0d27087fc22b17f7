"""Maker of head_runout.csv from the thesis' appendix D: how far the real head is from a perfect circle, per degree.

Usage: python sim_hw/plant/data/make_head_runout.py APPENDIX_D.csv > sim_hw/plant/data/head_runout.csv
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np


def main(source: Path) -> None:
    """Print the residuals of a rotational calibration (columns theta_deg, x_um, y_um) against its circle."""
    theta_deg, x_um, y_um = np.loadtxt(source, delimiter=",", skiprows=1, unpack=True)
    design = np.column_stack([2.0 * x_um, 2.0 * y_um, np.ones_like(x_um)])
    centre_x, centre_y, constant = np.linalg.lstsq(design, x_um**2 + y_um**2, rcond=None)[0]
    radius_um = math.sqrt(constant + centre_x**2 + centre_y**2)
    # The axes stood at (x, y) while the tip stood on the fixed control point: the tip's offset from the axes is
    # the control point minus (x, y), and the circle's centre is where a head without offset would have stood.
    offset = (centre_x - x_um) + 1j * (centre_y - y_um)
    turned = np.degrees(np.angle(offset)) - theta_deg
    phi_deg = float(np.mean((turned + 180.0) % 360.0 - 180.0))
    residual = offset - radius_um * np.exp(1j * np.radians(theta_deg + phi_deg))
    lines = [
        "# Run-out of a real head: offset of the tip from the head's axis, minus that of a perfect head.",
        "# Source: 2016 doctoral thesis, appendix D (rotational calibration record, 320 angles).",
        f"# Perfect head: radius {radius_um:.2f} um, offset angle theta {phi_deg:+.3f} deg.",
        "theta_deg,dx_um,dy_um",
    ]
    lines += [f"{t:.0f},{r.real:.2f},{r.imag:.2f}" for t, r in zip(theta_deg, residual, strict=True)]
    sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
