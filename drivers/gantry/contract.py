"""The machine's coordinates, settings and what lies outside of them. No I/O."""

from dataclasses import dataclass

from drivers.errors import EnvelopeViolation

# The head must never be between these angles (thesis, head angle 101..139 deg plus one degree each side)
THETA_LAST_DEG = 100.0
THETA_FIRST_DEG = 140.0
_GANTRY = "gantry"


@dataclass(frozen=True, slots=True)
class Position:
    """A place of the machine: um in the robot frame, Z up, theta about +Z in degrees.

    As a target, theta may be a head angle (0..360) or the axis coordinate (-220..100); as an answer it is the
    axis coordinate.
    """

    x_um: float
    y_um: float
    z_um: float
    theta_deg: float


@dataclass(frozen=True, slots=True)
class GantryConfig:
    """How the four axes move as one machine."""

    safe_z_um: float = 12000.0
    """Height from which lateral and rotary moves are free."""
    backlash_um: float = 50.0
    """X and Y come to every target from below, from at least this far (less at the lower end of the range)."""
    backlash_theta_deg: float = 0.5625
    """Theta comes to every target from below, from at least this far."""
    backlash_z_um: float = 0.0
    """Z comes to every target from above, from at least this far."""
    same_place_um: float = 0.5
    """A target this near in X and Y needs no lateral move, so Z need not be retracted."""
    same_place_deg: float = 0.01
    """The same for theta."""


def axis_theta_deg(theta_deg: float) -> float:
    """Map a head angle (any turn) to the axis coordinate in -220..100 deg; raise EnvelopeViolation in the band.

    The coordinate never contains the forbidden band, so no path along it can cross it.
    """
    # The 1e-9 keeps a round trip through floats on the end of the range
    head_deg = theta_deg % 360.0
    if head_deg <= THETA_LAST_DEG + 1e-9:
        return head_deg
    if head_deg >= THETA_FIRST_DEG - 1e-9:
        return head_deg - 360.0
    text = f"head angle {head_deg:.4f} deg is in the forbidden band {THETA_LAST_DEG:g}..{THETA_FIRST_DEG:g}"
    raise EnvelopeViolation(text, device=_GANTRY, advice="Turn the other way round, or use another angle.")
