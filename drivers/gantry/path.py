"""From here to there without touching anything: the legs of a move. Pure."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from drivers.errors import EnvelopeViolation
from drivers.gantry.contract import Approach, ClearHeight, GantryConfig, Position


@dataclass(frozen=True, slots=True)
class Leg:
    """Which axis goes where in one leg, each in its unit; the axes of a leg move together."""

    to: Mapping[str, float]
    speed_units_s: float | None = None
    """At most; None: as fast as each axis may."""


_FIELDS = {"x": "x_um", "y": "y_um", "theta": "theta_deg"}
_NO_ROOM = "Choose a target farther inside, or let the axis' range reach farther where the machine allows it."
# Sums of decimal numbers may be off by this much
_ROUNDING = 1e-6


@dataclass(frozen=True, slots=True)
class Ends:
    """Range of each axis, in its unit, as the configuration has it."""

    x_um: tuple[float, float]
    y_um: tuple[float, float]
    z_um: tuple[float, float]
    theta_deg: tuple[float, float]


def plan(
    now: Position,
    target: Position,
    config: GantryConfig,
    ends: Ends,
    from_above: frozenset[str] = frozenset(),
    slow_z_um: float | None = None,
    clear: ClearHeight | None = None,
    approach: Approach | None = None,
) -> list[Leg]:
    """List the legs: rise, go across with a one-sided approach, lower. Theta is the axis coordinate in both.

    A leg names only the axes that move. A pure Z move does not rise. Across it goes at the safe height or above; where
    `clear` knows a lower one for this way, at that. Axes in `from_above` (x, y, theta) come from the other side.
    `approach`: how much room below the target the others take, where that is known better than by the configuration.
    Below `slow_z_um` (None: the configuration's) Z goes down slowly; up it always goes fast. Raises EnvelopeViolation
    for a target so near to an end that there is no room for the approach.
    """
    legs: list[Leg] = []
    slow_z_um = config.slow_z_um if slow_z_um is None else slow_z_um
    across = _across(now, target, config, ends, from_above, approach)
    z_um = now.z_um
    across_um = _across_z_um(now, across, config, slow_z_um, clear)
    if across and z_um < across_um:
        z_um = across_um
        legs.append(Leg({"z": z_um}))
    legs += map(Leg, across)
    above_um = min(target.z_um + config.backlash_z_um, ends.z_um[1])
    if z_um < above_um and config.backlash_z_um > 0:
        z_um = above_um
        legs.append(Leg({"z": z_um}))
    return legs + _down(z_um, target.z_um, config, slow_z_um)


def _across_z_um(
    now: Position, across: list[dict[str, float]], config: GantryConfig, slow_z_um: float, clear: ClearHeight | None
) -> float:
    """Return the lowest Z for the way across: a known clear height from where no surface may be, else the safe one."""
    if clear is None or not across or now.z_um >= config.safe_z_um:
        return config.safe_z_um
    places = [now]
    for leg in across:
        places.append(replace(places[-1], **{_FIELDS[name]: to for name, to in leg.items()}))
    clear_um = clear(places)
    # Whatever is no height between both, NaN too, is none to go at
    if clear_um is None or not slow_z_um <= clear_um <= config.safe_z_um:
        return config.safe_z_um
    return clear_um


def _down(from_um: float, to_um: float, config: GantryConfig, slow_z_um: float) -> list[Leg]:
    """Go to a height: where the needle may meet a surface on the way, slowly from there on."""
    if to_um >= min(from_um, slow_z_um):
        return [Leg({"z": to_um})]
    fast = [Leg({"z": slow_z_um})] if from_um > slow_z_um else []
    return [*fast, Leg({"z": to_um}, config.slow_um_s)]


def _across(
    now: Position,
    target: Position,
    config: GantryConfig,
    ends: Ends,
    from_above: frozenset[str],
    approach: Approach | None,
) -> list[dict[str, float]]:
    """Go to a point below the target in X, Y and theta, then up to it: always the same flank of the screw.

    An axis that is there already stays: it came from the right side when it came. One without play comes straight.
    """
    axes = {
        "x": (now.x_um, target.x_um, config.same_place_um, ends.x_um),
        "y": (now.y_um, target.y_um, config.same_place_um, ends.y_um),
        "theta": (now.theta_deg, target.theta_deg, config.same_place_deg, ends.theta_deg),
    }
    lengths = _lengths(config, from_above, approach)
    aside: dict[str, float] = {}
    final: dict[str, float] = {}
    for name, (here, to, same, (low, high)) in axes.items():
        if abs(to - here) <= same:
            continue
        final[name], length = to, lengths[name]
        before = to + length if name in from_above else to - length
        if not low - _ROUNDING <= before <= high + _ROUNDING:
            side, end = ("above", high) if name in from_above else ("below", low)
            text = f"{name} {to:.4f} is too near to the end {end:g}: to come from {side}, {length:g} are needed"
            raise EnvelopeViolation(text, device="gantry", advice=_NO_ROOM)
        # From further out on that side it comes from the right one anyway
        if length > 0 and ((here < before) if name in from_above else (here > before)):
            aside[name] = before
    return [leg for leg in (aside, final) if leg]


def _lengths(config: GantryConfig, from_above: frozenset[str], approach: Approach | None) -> dict[str, float]:
    """Return how long each axis' approach is; one from above, which measures the play, is as configured."""
    whole = {"x": config.backlash_um, "y": config.backlash_um, "theta": config.backlash_theta_deg}
    if approach is None:
        return whole
    asked = {"x": approach.x_um, "y": approach.y_um, "theta": approach.theta_deg}
    return {name: whole[name] if name in from_above else asked[name] for name in whole}
