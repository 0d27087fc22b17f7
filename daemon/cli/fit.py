"""`reprobe calibrate fit`: head models fitted to a rotational record (thesis appendix D), and which predicts best."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

from daemon.cli.output import USAGE, AsJson, fail, out, say_json
from daemon.tools.rotation_csv import BadRecord, RotationalRecord, read_record
from vision.head import Choice, HeadFit, fit_head, head_positions_um, order_table, repeatability_um

LANDED_UM = 200.0
"""The thesis counts a landing within this distance (6.3)."""

Record = Annotated[Path, typer.Argument(help="CSV with the columns theta_deg, x_um, y_um; one row per head angle.")]
Model = Annotated[Choice, typer.Option(help="Kind of model; auto takes the one that predicts left-out rows best.")]
Every = Annotated[int, typer.Option(min=1, help="Fit on every so many rows only, and judge on the others.")]


def fit(record: Record, model: Model = "auto", every: Every = 1, as_json: AsJson = False) -> None:
    """Fit a head model to a rotational record, and say how well it predicts."""
    try:
        facts = head_facts(read_record(record), model, every)
    except BadRecord as exc:
        fail(str(exc), advice=exc.advice, code=USAGE)
    except ValueError as exc:
        fail(str(exc), advice="the record is kept as it is; nothing was stored", code=USAGE)
    if as_json:
        say_json(facts)
    else:
        _show(facts)


def head_facts(record: RotationalRecord, model: Choice = "auto", every: int = 1) -> dict[str, Any]:
    """Return what the record says as plain numbers, um; ValueError for a record no head can be fitted to."""
    chosen = np.arange(len(record)) % every == 0
    rows, others = record.rows(chosen), record.rows(~chosen)
    rigid = fit_head(rows.theta_deg, rows.x_um, rows.y_um, model="circle")
    best = fit_head(rows.theta_deg, rows.x_um, rows.y_um, model=model)
    off = np.hypot(*rigid.residuals_um.T)
    return {
        "rows": len(record),
        "fitted_rows": len(rows),
        "largest_gap_deg": best.largest_gap_deg,
        "circle": asdict(best.circle),
        "rigid": {
            "rms_um": rigid.rms_um,
            "max_um": float(off.max()),
            "within_um": LANDED_UM,
            "share_within": float((off <= LANDED_UM).mean()),
        },
        "orders": [asdict(row) for row in order_table(rows.theta_deg, rows.x_um, rows.y_um)],
        "model": {
            "kind": best.kind,
            "order": best.order,
            "rms_um": best.rms_um,
            "holdout_rms_um": best.holdout_rms_um,
            "holdout_max_um": best.holdout_max_um,
            "outliers_deg": [float(theta) for theta in rows.theta_deg[~best.used]],
        },
        "others": _judge(best, others) if len(others) else None,
        "repeatability_um": repeatability_um(rows.theta_deg, rigid.residuals_um),
    }


def _judge(best: HeadFit, others: RotationalRecord) -> dict[str, float]:
    """Return the errors at the angles that were not fitted."""
    measured = np.column_stack([others.x_um, others.y_um])
    off = np.hypot(*(head_positions_um(best.head, best.control_um, others.theta_deg) - measured).T)
    return {"rows": len(others), "rms_um": float(np.sqrt((off**2).mean())), "max_um": float(off.max())}


def _show(facts: dict[str, Any]) -> None:
    """Print the facts for people."""
    circle, rigid = facts["circle"], facts["rigid"]
    x_um, y_um = circle["centre_um"]
    grid = Table.grid(padding=(0, 2))
    grid.add_row("angles", f"{facts['fitted_rows']} of {facts['rows']}, largest gap {facts['largest_gap_deg']:.1f} deg")
    grid.add_row("circle", f"centre ({x_um:.1f}, {y_um:.1f}) um, radius {circle['radius_um']:.1f} um")
    grid.add_row("roundness", f"{circle['rms_um']:.1f} um rms from the circle")
    grid.add_row(
        "perfect head",
        f"{rigid['rms_um']:.1f} um rms, {rigid['max_um']:.1f} max, "
        f"{rigid['share_within']:.1%} of angles within {rigid['within_um']:.0f} um",
    )
    spread = facts["repeatability_um"]
    told = "not to be told: too few neighbouring angles" if spread is None else f"{spread:.1f} um (1 sigma, per axis)"
    grid.add_row("repeatability", told)
    out.print(grid)
    out.print(_orders(facts["orders"]))
    out.print(_verdict(facts))


def _orders(rows: list[dict[str, Any]]) -> Table:
    """Return the plain series of each order as a table."""
    table = Table(
        "order", "rms um", "left out, rms um", title="Fourier series, plain least squares", title_justify="left"
    )
    for column in table.columns:
        column.justify = "right"
    for row in rows:
        table.add_row(str(row["order"]), f"{row['rms_um']:.1f}", f"{row['holdout_rms_um']:.1f}")
    return table


def _verdict(facts: dict[str, Any]) -> Table:
    """Return the chosen model and its errors."""
    model, others = facts["model"], facts["others"]
    grid = Table.grid(padding=(0, 2))
    order = "" if model["order"] is None else f", order {model['order']}"
    grid.add_row("model", f"{model['kind']}{order}; leaves {model['rms_um']:.1f} um rms")
    grid.add_row("each row left out", f"{model['holdout_rms_um']:.1f} um rms, {model['holdout_max_um']:.1f} max")
    if others is not None:
        told = f"{others['rms_um']:.1f} um rms, {others['max_um']:.1f} max"
        grid.add_row(f"the other {others['rows']} angles", told)
    outliers = ", ".join(f"{theta:g}" for theta in model["outliers_deg"]) or "none"
    grid.add_row("outliers", outliers if outliers == "none" else f"[yellow]{outliers} deg[/], left out")
    return grid
