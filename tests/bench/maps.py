"""How well do the maps from the image to the robot correct? Simulated sightings, no pictures.

python -m tests.bench.maps [trials]

The simulated station's camera looks at a target under the tip; axes stop with 8 um planar scatter, tip and target are
found to 0.15 px per coordinate. In each of some rounds all maps are calibrated anew, as the daemon walks, and asked for
corrections of 50..700 um. Printed: the error of the way they give (rms, 95 %, largest) at the calibrated angle and at
any other; what the axes' stop then adds is the same for all. Last: the mean normalised squared error of the maps that
say how sure they are; 2 for an honest covariance. A second table has no noise: what the model itself costs.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from sim_hw.scene.optics import TIP_PX, make_optics
from vision.geometry.frames import Array, rotation
from vision.geometry.image_map import Correction, MapPoint, sightings_px, sightings_um
from vision.geometry.polar_map import fit_polar_map
from vision.geometry.pose_map import fit_pose_map
from vision.geometry.similarity import fit_similarity

STOP_UM, SEEN_PX, HOVER_UM, REACH_UM = 8.0, 0.15, 200.0, 700.0
RINGS = ((0.45, 6), (0.95, 10))
ANGLE_DEG = 30.0
ALLOWED_DEG = (140.0, 460.0)
ANGLES = 12
ROUNDS, TRIALS = 100, 50
OPTICS = make_optics()
Corrector = Callable[[tuple[float, float], tuple[float, float], float], Correction]
BELOW_TRUE = OPTICS.project((0.0, 0.0, -HOVER_UM))[0] - TIP_PX
# Two looks, tip and target in each.
BELOW_SIGMA_PX = SEEN_PX * 2.0


def pixel(from_tip_um: Array, theta_deg: float) -> Array:
    """Where a place, given from below the tip in the robot frame, is seen."""
    head = rotation(-theta_deg) @ from_tip_um
    return np.asarray(OPTICS.project((*head, -HOVER_UM))[0])


def walk(rng: np.random.Generator, theta_deg: float, noise: float) -> list[MapPoint]:
    """See one target from the places the map job visits; `noise` is a share of the usual."""
    head_um = np.array([3e4, 4e4]) - rotation(theta_deg) @ (15000.0, 0.0) + rng.normal(0.0, 100.0, 2)
    steps = [np.zeros(2), np.array([250.0, 0.0]), np.array([0.0, 250.0])]
    for radius, count in RINGS:
        steps += [rotation(360.0 * (k + radius) / count) @ (radius * REACH_UM, 0.0) for k in range(count)]
    found = []
    for step in steps:
        stop = rng.normal(0.0, noise * STOP_UM / np.sqrt(2.0), 2)
        # Positions of the picture are counted from the tip's, so both are uncertain in each.
        x, y = pixel(-(step + stop), theta_deg) + rng.normal(0.0, noise * SEEN_PX * np.sqrt(2.0), 2)
        place = head_um + step
        found.append(MapPoint((float(x), float(y)), float(place[0]), float(place[1]), theta_deg))
    return found


def linear(sightings: Sequence[MapPoint], below_px: Array, *, scale_only: bool) -> Corrector:
    """A plain affine, or one fixed factor and turn as the thesis' table 6.2 has it (328.06 per px, omega + pi / 2)."""
    px = sightings_px(sightings)
    head_um = (sightings_um(sightings).mean(axis=0) - sightings_um(sightings)) @ rotation(-sightings[0].theta_deg).T
    if scale_only:
        fit = fit_similarity(px * (1.0, -1.0), head_um)
        matrix = np.array([[fit.c, fit.s], [fit.s, -fit.c]])
    else:
        matrix = np.linalg.lstsq(np.c_[np.ones(len(px)), px], head_um, rcond=None)[0][1:].T

    def correction(target_px: tuple[float, float], tip_px: tuple[float, float], theta_deg: float) -> Correction:
        dx, dy = rotation(theta_deg) @ matrix @ (np.subtract(target_px, tip_px) - below_px)
        return Correction(float(dx), float(dy), np.full((2, 2), np.nan))

    return correction


def maps(rng: np.random.Generator, noise: float) -> dict[str, Corrector]:
    """Calibrate every map on the same walks."""
    angles = [a % 360.0 for a in np.linspace(*ALLOWED_DEG, ANGLES)]
    one, many = walk(rng, ANGLE_DEG, noise), [s for a in angles for s in walk(rng, a, noise)]
    below = BELOW_TRUE + rng.normal(0.0, noise * BELOW_SIGMA_PX, 2)

    def asked(fit: Callable[..., object], sightings: Sequence[MapPoint]) -> Corrector:
        found = fit(
            sightings,
            tip_px=TIP_PX,
            below_tip_px=(float(below[0]), float(below[1])),
            below_sigma_px=BELOW_SIGMA_PX,
            work_z_um=5200.0,
            hover_um=HOVER_UM,
        )
        return lambda target, tip, theta: found.correction(target, tip, theta, SEEN_PX * np.sqrt(2.0))  # type: ignore[attr-defined,no-any-return]

    return {
        "projective, 1 angle": asked(fit_pose_map, one),
        f"projective, {ANGLES} angles": asked(fit_pose_map, many),
        "polar array, 1 angle": asked(fit_polar_map, one),
        f"polar array, {ANGLES} angles": asked(fit_polar_map, many),
        "affine, 1 angle": linear(one, below, scale_only=False),
        "one factor, 1 angle": linear(one, below, scale_only=True),
    }


@dataclass
class Tally:
    """What one map left, um, and how that compares with what it expected."""

    errors_um: list[float] = field(default_factory=list)
    normalised: list[float] = field(default_factory=list)

    def add(self, way: Correction, truth_um: Array) -> None:
        error = np.array([way.dx_um, way.dy_um]) - truth_um
        self.errors_um.append(float(np.linalg.norm(error)))
        self.normalised.append(float(error @ np.linalg.solve(way.covariance, error)))

    def figures(self) -> tuple[float, float, float]:
        e = np.array(self.errors_um)
        return float(np.sqrt((e**2).mean())), float(np.percentile(e, 95)), float(e.max())


def run(rounds: int, trials: int, noise: float, seed: int = 1) -> dict[str, tuple[Tally, Tally]]:
    """Return per map what it left at the calibrated angle and at others."""
    rng = np.random.default_rng(seed)
    tallies: dict[str, tuple[Tally, Tally]] = {}
    for _ in range(rounds):
        correctors = maps(rng, noise)
        for name in correctors:
            tallies.setdefault(name, (Tally(), Tally()))
        for k in range(2 * trials):
            theta = ANGLE_DEG if k % 2 == 0 else float(rng.uniform(*ALLOWED_DEG)) % 360.0
            truth = rotation(float(rng.uniform(0.0, 360.0))) @ (float(rng.uniform(50.0, 700.0)), 0.0)
            target = pixel(truth, theta) + rng.normal(0.0, noise * SEEN_PX, 2)
            tip = TIP_PX + rng.normal(0.0, noise * SEEN_PX, 2)
            for name, correct in correctors.items():
                way = correct((float(target[0]), float(target[1])), (float(tip[0]), float(tip[1])), theta)
                tallies[name][k % 2].add(way, truth)
    return tallies


def table(tallies: dict[str, tuple[Tally, Tally]], *, honest: bool) -> None:
    print("| map | calibrated angle: rms | p95 | max | any angle: rms | p95 | max | normalised² |")
    print("|---|---|---|---|---|---|---|---|")
    for name, (here, there) in tallies.items():
        figures = " | ".join(f"{v:.1f}" for v in (*here.figures(), *there.figures()))
        normalised = float(np.mean(here.normalised + there.normalised)) if honest else np.nan
        print(f"| {name} | {figures} | {'-' if np.isnan(normalised) else f'{normalised:.2f}'} |")


def main(trials: int) -> None:
    print(f"Error of the way after one look, um; {ROUNDS} calibrations, {trials} corrections of 50..700 um each\n")
    table(run(ROUNDS, trials, noise=1.0), honest=True)
    print("\nThe same without any noise: what the model itself costs\n")
    table(run(1, trials, noise=0.0), honest=False)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else TRIALS)
