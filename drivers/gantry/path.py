"""From here to there without touching anything: the legs of a move. Pure."""

from collections.abc import Mapping
from dataclasses import dataclass

from drivers.gantry.contract import GantryConfig, Position

# Which axis goes where in one leg; the axes of a leg move together
Leg = Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Ends:
    """Range of each axis, in its unit, as the configuration has it."""

    x_um: tuple[float, float]
    y_um: tuple[float, float]
    z_um: tuple[float, float]
    theta_deg: tuple[float, float]


def plan(now: Position, target: Position, config: GantryConfig, ends: Ends) -> list[Leg]:
    """List the legs: retract, go across with a one-sided approach, lower. Theta is the axis coordinate in both.

    A leg names only the axes that move. A pure Z move has no retract.
    """
    legs: list[Leg] = []
    lateral = _is_lateral(now, target, config)
    z_um = now.z_um
    if lateral:
        if z_um < config.safe_z_um:
            z_um = config.safe_z_um
            legs.append({"z": z_um})
        legs += _across(now, target, config, ends)
    above_um = min(target.z_um + config.backlash_z_um, ends.z_um[1])
    if z_um < above_um and config.backlash_z_um > 0:
        legs.append({"z": above_um})
    legs.append({"z": target.z_um})
    return legs


def _is_lateral(now: Position, target: Position, config: GantryConfig) -> bool:
    return (
        abs(target.x_um - now.x_um) > config.same_place_um
        or abs(target.y_um - now.y_um) > config.same_place_um
        or abs(target.theta_deg - now.theta_deg) > config.same_place_deg
    )


def _across(now: Position, target: Position, config: GantryConfig, ends: Ends) -> list[Leg]:
    """Go to a point below the target in X, Y and theta, then up to it: always the same flank of the screw."""
    before = {
        "x": max(target.x_um - config.backlash_um, ends.x_um[0]),
        "y": max(target.y_um - config.backlash_um, ends.y_um[0]),
        "theta": max(target.theta_deg - config.backlash_theta_deg, ends.theta_deg[0]),
    }
    here = {"x": now.x_um, "y": now.y_um, "theta": now.theta_deg}
    # An axis already below the point comes from the right side anyway
    aside = {name: at for name, at in before.items() if here[name] > at}
    final = {"x": target.x_um, "y": target.y_um, "theta": target.theta_deg}
    return [aside, final] if aside else [final]
