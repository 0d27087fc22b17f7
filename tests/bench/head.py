"""Compare models of the head: how well they predict the angles they were not given (appendix D).

python -m tests.bench.head [--draws 6]

The record is rebuilt from the run-out the project keeps, so the bench needs nothing else. Angles are chosen evenly over
the rows, beginning anywhere; every model is fitted on the same rows and judged on all others. "+8 um" adds that much
Gaussian noise per axis to the rows fitted, and none to those judged: the record has its own 8 um in it already, below
which no model can come.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table
from scipy.interpolate import CubicSpline, RBFInterpolator

from tests.vision.head_records import rebuilt_record
from vision.head.circle import fit_rotation
from vision.head.fit import Kind, fit_head, head_positions_um, order_table

Floats = NDArray[np.float64]
Model = Callable[[Floats, Floats], Floats]
COUNTS = (8, 12, 16, 22, 24, 32, 48, 64, 160)
NOISES_UM = (0.0, 8.0)
SMOOTHINGS = 10.0 ** np.arange(-6.0, 1.0, 0.5)


def ours(kind: Kind | None) -> Model:
    def model(rows: Floats, theta: Floats) -> Floats:
        fit = fit_head(*rows.T, model=kind or "auto")
        return head_positions_um(fit.head, fit.control_um, theta)

    return model


def plain_series(rows: Floats, theta: Floats) -> Floats:
    """Least squares without a prior; the order by leave-one-out."""
    order = min(order_table(*rows.T), key=lambda row: row.holdout_rms_um).order
    known, wanted = (np.exp(1j * np.radians(t)[:, None] * np.arange(-order, order + 1)) for t in (rows[:, 0], theta))
    place = wanted @ np.linalg.lstsq(known, rows[:, 1] + 1j * rows[:, 2], rcond=None)[0]
    return np.column_stack([place.real, place.imag])


def on_residuals(interpolate: Model) -> Model:
    """A peer that sees only what a perfect head leaves over."""

    def model(rows: Floats, theta: Floats) -> Floats:
        centre, arm = fit_rotation(rows[:, 0], rows[:, 1] + 1j * rows[:, 2])
        circles = [centre + arm * np.exp(1j * np.radians(t)) for t in (rows[:, 0], theta)]
        known, wanted = (np.column_stack([c.real, c.imag]) for c in circles)
        return wanted + interpolate(np.column_stack([rows[:, 0], rows[:, 1:] - known]), theta)

    return model


def spline(rows: Floats, theta: Floats) -> Floats:
    closed = np.vstack([rows, rows[:1] + np.array([360.0, 0.0, 0.0])])
    return CubicSpline(closed[:, 0], closed[:, 1:], bc_type="periodic")((theta - rows[0, 0]) % 360.0 + rows[0, 0])


def rbf(rows: Floats, theta: Floats) -> Floats:
    """Thin-plate spline (scipy) on the unit circle; its smoothing by leave-one-out in ten parts."""
    known, wanted = (np.column_stack([np.cos(t), np.sin(t)]) for t in (np.radians(rows[:, 0]), np.radians(theta)))
    part = np.arange(len(rows)) % min(10, len(rows))

    def left_out(smoothing: float) -> float:
        off = 0.0
        for p in range(part.max() + 1):
            here = part == p
            guess = RBFInterpolator(known[~here], rows[~here, 1:], smoothing=smoothing)(known[here])
            off += float(((guess - rows[here, 1:]) ** 2).sum())
        return off

    return RBFInterpolator(known, rows[:, 1:], smoothing=min(SMOOTHINGS, key=left_out))(wanted)


MODELS: dict[str, Model] = {
    "circle": ours("circle"),
    "array": ours("array"),
    "Fourier": ours("fourier"),
    "auto": ours(None),
    "plain series": plain_series,
    "cubic spline": on_residuals(spline),
    "RBF, smoothed": on_residuals(rbf),
}


def errors(model: Model, record: Floats, count: int, noise_um: float, draws: int) -> Floats:
    """Return (rms, p99, max) of the distances at the angles left out; mean over the draws, max over them all."""
    rng = np.random.default_rng(count)
    found = []
    for _ in range(draws):
        chosen = np.zeros(len(record), dtype=bool)
        chosen[(np.arange(count) * len(record) / count + rng.uniform(0, len(record) / count)).astype(int)] = True
        rows = record[chosen].copy()
        rows[:, 1:] += rng.normal(size=(count, 2)) * noise_um
        off = np.hypot(*(model(rows, record[~chosen, 0]) - record[~chosen, 1:]).T)
        found.append((np.sqrt((off**2).mean()), np.percentile(off, 99), off.max()))
    rms, p99, worst = np.array(found).T
    return np.array([rms.mean(), p99.mean(), worst.max()])


def main() -> None:
    parser = argparse.ArgumentParser(description="Compare models of the head on appendix D.")
    parser.add_argument("--draws", type=int, default=6, help="choices of angles (and noise) per line")
    draws = parser.parse_args().draws
    record = rebuilt_record()
    table = Table("angles", "noise um", *MODELS, title="um at the angles left out: rms / p99 / max")
    lines = [(count, noise) for count in COUNTS for noise in NOISES_UM]
    for count, noise in track(lines, console=Console(stderr=True), description="fitting"):
        results = [errors(model, record, count, noise, draws) for model in MODELS.values()]
        best = min(range(len(results)), key=lambda i: results[i][0])
        cells = [" / ".join(f"{v:.0f}" if k else f"{v:.1f}" for k, v in enumerate(r)) for r in results]
        cells[best] = f"[bold]{cells[best]}[/]"
        table.add_row(str(count), f"+{noise:.0f}", *cells, end_section=noise == NOISES_UM[-1])
    Console(width=170).print(table)


if __name__ == "__main__":
    main()
