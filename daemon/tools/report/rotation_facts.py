"""Facts of a rotation's record: deviations from the circle, the model's course, landings, drift."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from daemon.storage.calibration_records import RotationRecord, SeenTarget, TrialLanding
from drivers.gantry.contract import THETA_FIRST_DEG, THETA_LAST_DEG
from vision.geometry import Array
from vision.head import head_from_dict, tip_offsets_um

FORBIDDEN_DEG: Final = (THETA_LAST_DEG, THETA_FIRST_DEG)
"""Between these the head may not be; nothing is measured there and no curve is drawn."""
LEAST_PAIRS: Final = 3
"""A straight line through fewer pairs says nothing about linearity."""


@dataclass(frozen=True)
class Polar:
    """Deviations from the perfect circle, (N,) each, um: outwards, and ahead in the sense of turning."""

    radial_um: Array
    tangential_um: Array


class Rotation:
    """The stops of a record against its circle and its head model."""

    def __init__(self, record: RotationRecord) -> None:
        n = len(record.stops)
        if not n or len(record.used) != n or len(record.residuals_um) != n:
            raise ValueError(
                f"{n} stops, {len(record.used)} used and {len(record.residuals_um)} residuals do not belong together; "
                "calibrate the rotation again"
            )
        self.record = record
        self.head = head_from_dict(record.head)
        self.theta_deg = np.array([stop.theta_deg for stop in record.stops])
        self.stops_um = np.array([(stop.x_um, stop.y_um) for stop in record.stops])
        self.used = np.array(record.used, dtype=bool)
        if not self.used.any() or record.circle.radius_um <= 0:
            raise ValueError("no stop was used or the circle has no radius; calibrate the rotation again")
        self.left_um = np.array(record.residuals_um)
        self.centre_um = np.array(record.circle.centre_um)
        self.radius_um = record.circle.radius_um
        self.phase_deg = self._phase()
        control = self.stops_um - self.left_um + tip_offsets_um(self.head, self.theta_deg)
        self.control_um = control[self.used].mean(axis=0)
        """Where the model has the control point; constant in the robot frame, so the head cannot hold it."""

    def _phase(self) -> float:
        """Return the mean direction of the stops from the centre at theta 0."""
        away = self.stops_um[self.used] - self.centre_um
        turned = np.exp(1j * (np.arctan2(away[:, 1], away[:, 0]) - np.radians(self.theta_deg[self.used])))
        return math.degrees(float(np.angle(turned.sum())))

    def ideal_um(self, theta_deg: Array) -> Array:
        """Return where a perfect head would stand at angles (N,), shape (N, 2)."""
        turn = np.radians(theta_deg + self.phase_deg)
        return np.asarray(self.centre_um + self.radius_um * np.column_stack([np.cos(turn), np.sin(turn)]))

    def modelled_um(self, theta_deg: Array) -> Array:
        """Return where the model has the head stand at angles (N,), shape (N, 2)."""
        return np.asarray(self.control_um - tip_offsets_um(self.head, theta_deg))

    def polar(self, theta_deg: Array, places_um: Array) -> Polar:
        """Return how far places (N, 2) are from the perfect circle at their angles (N,)."""
        away = places_um - self.centre_um
        lag = np.arctan2(away[:, 1], away[:, 0]) - np.radians(theta_deg + self.phase_deg)
        wrapped = np.angle(np.exp(1j * lag))
        return Polar(np.hypot(away[:, 0], away[:, 1]) - self.radius_um, self.radius_um * wrapped)

    def polar_left(self) -> Polar:
        """Return the model's residuals, outwards and ahead."""
        turn = np.radians(self.theta_deg + self.phase_deg)
        out = np.column_stack([np.cos(turn), np.sin(turn)])
        ahead = np.column_stack([-np.sin(turn), np.cos(turn)])
        return Polar((self.left_um * out).sum(axis=1), (self.left_um * ahead).sum(axis=1))

    @property
    def rigid_rms_um(self) -> float:
        """How well one radius and one angle explain the stops that were used."""
        off = (self.stops_um - self.ideal_um(self.theta_deg))[self.used]
        return float(np.sqrt((off**2).sum(axis=1).mean()))


def lengths_um(landings: Sequence[TrialLanding]) -> Array:
    """Return how far off each landing was, (N,), um."""
    return np.array([math.hypot(landing.dx_um, landing.dy_um) for landing in landings])


def allowed_stretches(step_deg: float = 0.5) -> tuple[Array, Array]:
    """Return the angles from 0 to the forbidden band and from there to 360."""
    below, above = FORBIDDEN_DEG
    return np.arange(0.0, below + step_deg / 2, step_deg), np.arange(above, 360.0 + step_deg / 2, step_deg)


# --- linearity --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Linearity:
    """Distances in the picture against distances of the head, from the sighting nearest to the stop (eq. 6.5, 6.6).

    theta_deg: the angle, or None if no angle has enough pairs and all are taken together. others: pairs of the other
    angles. um_per_px: slope of the line through the origin.
    """

    theta_deg: float | None
    image_px: Array
    robot_um: Array
    others_px: Array
    others_um: Array
    um_per_px: float

    @property
    def residual_um(self) -> Array:
        """What the line leaves of the head's distances, (N,)."""
        return self.robot_um - self.um_per_px * self.image_px


def linearity(record: RotationRecord) -> Linearity | None:
    """Return the pairs at the angle with most sightings; None if there are too few sightings altogether."""
    by_angle: defaultdict[float, list[SeenTarget]] = defaultdict(list)
    for seen in record.sightings:
        by_angle[round(seen.theta_deg, 3)].append(seen)
    stops = {round(stop.theta_deg, 3): (stop.x_um, stop.y_um) for stop in record.stops}
    pairs = {theta: _pairs(seen, stops[theta]) for theta, seen in by_angle.items() if theta in stops}
    if sum(len(rows) for rows in pairs.values()) < LEAST_PAIRS:
        return None
    fullest = max(pairs, key=lambda theta: len(pairs[theta]))
    enough = len(pairs[fullest]) >= LEAST_PAIRS
    everything = np.vstack(list(pairs.values()))
    mine = pairs[fullest] if enough else everything
    rest = [rows for theta, rows in pairs.items() if theta != fullest]
    others = np.vstack(rest) if enough and rest else np.empty((0, 2))
    square = float((mine[:, 0] ** 2).sum())
    if square <= 0.0:
        return None
    slope = float((mine[:, 0] * mine[:, 1]).sum()) / square
    return Linearity(fullest if enough else None, mine[:, 0], mine[:, 1], others[:, 0], others[:, 1], slope)


def _pairs(seen: Sequence[SeenTarget], stop_um: tuple[float, float]) -> Array:
    """Return (px, um) from the sighting nearest to the stop to every other one, shape (N - 1, 2)."""
    first = min(seen, key=lambda s: math.dist((s.x_um, s.y_um), stop_um))
    rows = [
        (math.dist(s.target_px, first.target_px), math.dist((s.x_um, s.y_um), (first.x_um, first.y_um)))
        for s in seen
        if s is not first
    ]
    return np.array(rows, dtype=float).reshape(-1, 2)


# --- drift ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Drift:
    """How far the new model puts the tip from the old one.

    stretches: (angles, difference outwards, ahead, length) on each side of the forbidden band, um.
    """

    stretches: tuple[tuple[Array, Array, Array, Array], ...]
    radius_um: float
    phase_deg: float
    centre_um: Array

    @property
    def rms_um(self) -> float:
        """Root mean square of the lengths."""
        return float(np.sqrt(np.mean(np.concatenate([s[3] for s in self.stretches]) ** 2)))

    @property
    def max_um(self) -> float:
        """The largest length."""
        return float(max(s[3].max() for s in self.stretches))


def drift(now: Rotation, before: Rotation) -> Drift:
    """Compare the tip's offset by two models over all allowed angles."""
    stretches = []
    for theta in allowed_stretches():
        new, old = tip_offsets_um(now.head, theta), tip_offsets_um(before.head, theta)
        difference = new - old
        out = old / np.maximum(1e-9, np.linalg.norm(old, axis=1))[:, None]
        ahead = np.column_stack([-out[:, 1], out[:, 0]])
        stretches.append((theta, (difference * out).sum(axis=1), (difference * ahead).sum(axis=1),
                          np.linalg.norm(difference, axis=1)))  # fmt: skip
    turned = (now.phase_deg - before.phase_deg + 180.0) % 360.0 - 180.0
    return Drift(tuple(stretches), now.radius_um - before.radius_um, turned, now.centre_um - before.centre_um)
