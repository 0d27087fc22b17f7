"""Records from numbers, for the pages' tests: the head is the real one of `sim_hw/plant/data/head_runout.csv`."""

from __future__ import annotations

import csv
import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from daemon.storage.calibration_records import (
    AlignmentRecord,
    BacklashRecord,
    MapRecord,
    RotationRecord,
    SurfaceRecord,
)
from vision.geometry.frames import rotation
from vision.geometry.pose_map import MapPoint, PoseMap, fit_pose_map
from vision.geometry.surface_plane import fit_plane
from vision.head.circle import fit_circle
from vision.head.model import CircleHead, FourierHead, head_to_dict, tip_offsets_um

RUNOUT = Path(__file__).parents[4] / "sim_hw" / "plant" / "data" / "head_runout.csv"
RADIUS_UM, PHASE_DEG = 14938.26, -3.054
CONTROL_UM = np.array((350_000.0, 300_000.0))
TIP_PX, BELOW_PX = (800.0, 620.0), (14.0, 26.0)
CAMERA_UM_PER_PX = 12.0
VIEW_DEG = 30.0


def made(**changes: Any) -> dict[str, Any]:
    """Return what every record says of itself."""
    return {"station": "bench-1", "made_at": "2026-03-04T05:06:07.000+00:00", "job": "job-17", "probe": "0123abcd",
            "seconds": 118.4, "looks": 61} | changes  # fmt: skip


def real_offsets() -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Return the real head's angles (N,) and its tip's offsets (N, 2), um."""
    lines = [line for line in RUNOUT.read_text().splitlines() if not line.startswith("#")]
    rows = list(csv.DictReader(lines))
    theta = np.array([float(row["theta_deg"]) for row in rows])
    off = np.array([(float(row["dx_um"]), float(row["dy_um"])) for row in rows])
    return theta, tip_offsets_um(CircleHead(RADIUS_UM, PHASE_DEG), theta) + off


def fourier(theta: Any, place: Any, order: int) -> tuple[FourierHead, complex]:
    """Fit a series to tip offsets plainly; return it and the constant that does not belong to it."""
    harmonics = np.arange(-order, order + 1)
    design = np.exp(1j * np.radians(theta)[:, None] * harmonics)
    c = np.linalg.lstsq(design, place[:, 0] + 1j * place[:, 1], rcond=None)[0]
    return FourierHead(tuple(complex(v) for v in np.delete(c, order))), complex(c[order])


def rotation_record(every: int = 15, *, seed: int = 1, outlier: bool = True, grown_um: float = 0.0,
                    **changes: Any) -> RotationRecord:  # fmt: skip
    """Return a rotation of the real head at every nth angle; `grown_um` lengthens the head."""
    rng = np.random.default_rng(seed)
    theta_all, offsets_all = real_offsets()
    offsets_all = offsets_all * (1.0 + grown_um / RADIUS_UM) + rng.normal(0, 4, offsets_all.shape)
    theta, offsets = theta_all[::every], offsets_all[::every]
    head, constant = fourier(theta, offsets, 6 if every <= 20 else 3)
    stops = CONTROL_UM - offsets
    shift = np.array((constant.real, constant.imag))
    model = CONTROL_UM - shift - tip_offsets_um(head, theta)
    used = np.ones(len(theta), dtype=bool)
    if outlier:
        used[4] = False
        stops[4] += (190.0, -120.0)
    left = stops - model
    rest = np.setdiff1d(np.arange(len(theta_all)), np.arange(len(theta_all))[::every])
    after = (offsets_all - tip_offsets_um(head, theta_all) - shift)[rest]
    before = offsets - tip_offsets_um(CircleHead(RADIUS_UM, PHASE_DEG + 0.4), theta)
    circle = fit_circle(*stops[used].T)
    held = np.linalg.norm(after, axis=1)
    pairs = sightings(theta, stops, rng)
    raw = made(**changes) | {
        "control_um": tuple(CONTROL_UM), "card_height_um": 40.0,
        "stops": [{"theta_deg": t, "x_um": x, "y_um": y, "off_um": 80.0, "looks": 2}
                  for t, (x, y) in zip(theta, stops, strict=True)],
        "used": used.tolist(), "residuals_um": left.tolist(), "head": head_to_dict(head), "kind": "fourier",
        "order": head.order, "rms_um": float(np.sqrt((left[used] ** 2).sum(axis=1).mean())),
        "holdout_rms_um": float(np.sqrt((held**2).mean())), "holdout_max_um": float(held.max()),
        "circle": {"centre_um": circle.centre_um, "radius_um": circle.radius_um, "rms_um": circle.rms_um},
        "total_error_um": 541.7, "closure_um": 6.3,
        "before": [{"theta_deg": t, "dx_um": x, "dy_um": y} for t, (x, y) in zip(theta, before, strict=True)],
        "after": [{"theta_deg": theta_all[k], "dx_um": x, "dy_um": y}
                  for k, (x, y) in zip(rest[::37], after[::37], strict=True)],
        "sightings": pairs,
    }  # fmt: skip
    return RotationRecord.model_validate_json(json.dumps(raw))


def camera_px(head_um: Any) -> Any:
    """Project places below the tip, head frame um (N, 2), into a camera that looks obliquely; px (N, 2)."""
    x, y = np.atleast_2d(head_um).T
    depth = 1.0 + math.sin(math.radians(VIEW_DEG)) * y / 90_000.0
    u = x / CAMERA_UM_PER_PX / depth
    v = -y * math.cos(math.radians(VIEW_DEG)) / CAMERA_UM_PER_PX / depth
    return np.column_stack([u, v]) + np.add(TIP_PX, BELOW_PX)


def sightings(theta: Any, stops: Any, rng: Any) -> list[dict[str, Any]]:
    """Return two sightings at each angle and a walk of nine at the first."""
    found = []
    for k, (t, stop) in enumerate(zip(theta, stops, strict=True)):
        walk = [(900 - 110 * n, -400 + 45 * n) for n in range(9)] if k == 0 else [tuple(rng.normal(0, 90, 2)), (4, 3)]
        for away in walk:
            head_um = rotation(-t) @ -np.asarray(away, dtype=float)
            px = camera_px(head_um)[0] + rng.normal(0, 0.08, 2)
            x_um, y_um = stop + away
            found.append({"theta_deg": t, "target_px": px.tolist(), "x_um": x_um, "y_um": y_um})
    return found


def map_record(*, seed: int = 1, stretch: float = 1.0, noise_um: float = 5.0, **changes: Any) -> MapRecord:
    """Return a map of seventeen sightings round one mark; `stretch` makes its um longer."""
    rng = np.random.default_rng(seed)
    places = [(0.0, 0.0), *((r * math.cos(a), r * math.sin(a)) for r, n in ((315.0, 6), (665.0, 10))
                            for a in np.linspace(0.3, 0.3 + 2 * math.pi, n, endpoint=False))]  # fmt: skip
    theta = 30.0
    seen = []
    for away in places:
        px = camera_px(rotation(-theta) @ -np.asarray(away))[0]
        x, y = (CONTROL_UM + np.asarray(away) * stretch + rng.normal(0, noise_um, 2)).tolist()
        seen.append(MapPoint((float(px[0]), float(px[1])), x, y, theta))
    fitted: PoseMap = fit_pose_map(seen, tip_px=TIP_PX, below_tip_px=BELOW_PX, work_z_um=20_000.0, hover_um=500.0)
    raw = made(**changes) | {
        "mark": "C7", "theta_deg": theta, "tip_px": TIP_PX, "pose_map": json.loads(fitted.to_json()),
        "sightings": [asdict(s) for s in seen],
    }  # fmt: skip
    return MapRecord.model_validate_json(json.dumps(raw))


def surface_record(*, bend_um: float = 0.0, hole_um: float = 0.0, raised_um: float = 0.0,
                   tilt_um: float = 18.0, seed: int = 1,
                   **changes: Any) -> SurfaceRecord:  # fmt: skip
    """Return a tilted plane touched at twelve places; `bend_um` bends it, `hole_um` lowers the third place."""
    rng = np.random.default_rng(seed)
    at = rng.uniform((200e3, 150e3), (330e3, 260e3), (12, 2))
    u = (at - (265e3, 205e3)) / 65e3
    height = raised_um + 45.0 + tilt_um * u[:, 0] - 9.0 * u[:, 1] + bend_um * u[:, 0] ** 2 + rng.normal(0, 2.5, 12)
    height[2] -= hole_um
    plane = fit_plane(at, height)
    raw = made(**changes) | {
        "touches": [{"x_um": x, "y_um": y, "height_um": h} for (x, y), h in zip(at, height, strict=True)],
        "residuals_um": plane.residuals_um.tolist(), "surface": plane.to_dict(), "flatness_um": plane.flatness_um,
        "rms_um": plane.rms_um, "limit_um": 50.0, "planar": bool(np.ptp(height) <= 50.0),
    }  # fmt: skip
    return SurfaceRecord.model_validate_json(json.dumps(raw))


def backlash_record(
    *, play_um: float = 14.0, approach_um: float = 200.0, seed: int = 1, **changes: Any
) -> BacklashRecord:
    """Return the play of both axes from eight arrivals a side."""
    rng = np.random.default_rng(seed)

    def axis(play: float) -> dict[str, Any]:
        below, above = rng.normal(120.0, 3.0, 8), rng.normal(120.0 + play, 3.0, 8)
        sigma = math.hypot(below.std(ddof=1), above.std(ddof=1)) / math.sqrt(8)
        return {"from_below_um": below.tolist(), "from_above_um": above.tolist(),
                "backlash_um": float(above.mean() - below.mean()), "sigma_um": sigma}  # fmt: skip

    raw = made(**changes) | {"x": axis(play_um), "y": axis(0.6 * play_um), "approach_um": approach_um}
    return BacklashRecord.model_validate_json(json.dumps(raw))


def alignment_record(*, scale: float = 1.00031, shift_um: float = 0.0, wrong_um: float = 0.0, seed: int = 1,
                     **changes: Any) -> AlignmentRecord:  # fmt: skip
    """Return a board of four fiducials; `wrong_um` puts the first one elsewhere."""
    rng = np.random.default_rng(seed)
    board = np.array([(5e3, 5e3), (95e3, 5e3), (95e3, 65e3), (5e3, 65e3)])
    placed = scale * board @ rotation(0.42).T + (210_000.0 + shift_um, 180_000.0)
    left = rng.normal(0, 6, board.shape)
    left[0] += (wrong_um, 0.0)
    raw = {"board": "nucleo", "side": "top"} | made(**changes) | {
        "theta_deg": 0.42, "scale": scale, "tx_um": 210_000.0 + shift_um, "ty_um": 180_000.0,
        "rms_um": float(np.sqrt((left**2).sum(axis=1).mean())),
        "fiducials": [{"name": f"FID{k + 1}", "board_um": b, "robot_um": (p + r).tolist(), "residual_um": r.tolist(),
                       "views": 2}
                      for k, (b, p, r) in enumerate(zip(board.tolist(), placed, left, strict=True))],
    }  # fmt: skip
    return AlignmentRecord.model_validate_json(json.dumps(raw))
