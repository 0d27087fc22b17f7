"""Page of a board's alignment."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from markupsafe import Markup

from daemon.storage.calibration_records import AlignmentRecord
from daemon.tools.report.page import Number, PageVerdict, Plot
from daemon.tools.report.svg import INK, MAIN, SECOND, TIMES, new_figure, to_svg
from vision.geometry import Array

SUBJECT: Final = "Alignment of the board"
MAGNIFIED: Final = (1000, 500, 200, 100, 50, 20, 10)


def _ppm(record: AlignmentRecord) -> float:
    return (record.scale - 1.0) * 1e6


def _limit_ppm(record: AlignmentRecord) -> float:
    return record.limits.scale_error * 1e6


def _lengths_um(record: AlignmentRecord) -> Array:
    """Return how far off each fiducial is, (N,); ValueError without fiducials."""
    if not record.fiducials:
        raise ValueError("the alignment has no fiducials; align the board again")
    return np.array([math.hypot(*fiducial.residual_um) for fiducial in record.fiducials])


def verdict(record: AlignmentRecord) -> PageVerdict:
    """Judge by the largest residual and the scale, by the limits that the calibration had."""
    worst, limit_um, limit_ppm = float(_lengths_um(record).max()), record.limits.residual_um, _limit_ppm(record)
    good = worst <= limit_um and abs(_ppm(record)) <= limit_ppm
    because = (
        f"Board {record.board}, {record.side} side: {len(record.fiducials)} fiducials leave {record.rms_um:.1f} um "
        f"rms, {worst:.1f} um at most (limit {limit_um:.0f} um), at a scale {_ppm(record):+.0f} ppm from 1 "
        f"(limit {limit_ppm:.0f} ppm)."
    )
    return PageVerdict(good, because)


def _off_nominal(record: AlignmentRecord) -> tuple[Number, ...]:
    """Return how far the board lies from where the configuration has it, as the result of the job says it."""
    if record.conditions is None:
        return ()
    return (
        Number("board off its nominal place, X", record.tx_um - record.conditions.origin_x_um, "um"),
        Number("board off its nominal place, Y", record.ty_um - record.conditions.origin_y_um, "um"),
    )


def numbers(record: AlignmentRecord) -> tuple[Number, ...]:
    """Return the figures of the table, each fiducial at the end."""
    lengths, limit_um = _lengths_um(record), record.limits.residual_um
    ppm, limit_ppm = _ppm(record), _limit_ppm(record)
    limit = f"at most {limit_um:.0f} um"
    rows = [
        Number("board", f"{record.board}, {record.side}"),
        Number("board's corner X, robot frame", record.tx_um, "um"),
        Number("board's corner Y, robot frame", record.ty_um, "um"),
        *_off_nominal(record),
        Number("turn", record.theta_deg, "deg", 4),
        Number("scale from 1", ppm, "ppm", 0, f"within {limit_ppm:.0f} ppm", abs(ppm) > limit_ppm),
        Number("left at the fiducials, rms", record.rms_um, "um"),
    ]
    rows += [
        Number(
            f"{fiducial.name}: left ({fiducial.views} views)", float(length), "um", 1, limit, length > limit_um
        )
        for fiducial, length in zip(record.fiducials, lengths, strict=True)
    ]  # fmt: skip
    return (*rows, Number("looks", float(record.looks), "", 0), Number("time taken", record.seconds, "s"))


def comparable(record: AlignmentRecord, previous: AlignmentRecord) -> bool:
    """Whether both are of the same side of the same board; else there is no drift to speak of."""
    return (record.board, record.side) == (previous.board, previous.side)


def plots(record: AlignmentRecord, previous: AlignmentRecord | None) -> tuple[Plot, ...]:
    """Return the plots."""
    left = np.array([fiducial.residual_um for fiducial in record.fiducials])
    times, svg = _fiducials(record, left, MAIN, "left at the fiducials")
    caption = (
        "The fiducials where they were seen, robot frame. Arrows: seen minus where the alignment puts them, magnified "
        f"{times} times."
    )
    drawn = (Plot("Fiducials", svg, caption),)
    return (*drawn, _drift(record, previous)) if previous else drawn


def placed_um(record: AlignmentRecord, board_um: Array) -> Array:
    """Return robot coordinates of places of the board, (N, 2)."""
    turn = math.radians(record.theta_deg)
    c, s = record.scale * math.cos(turn), record.scale * math.sin(turn)
    return np.asarray(board_um @ np.array([[c, s], [-s, c]]) + (record.tx_um, record.ty_um))


def _apart_um(record: AlignmentRecord, previous: AlignmentRecord) -> Array:
    """Return by how much each fiducial is put elsewhere than before, (N, 2)."""
    board = np.array([fiducial.board_um for fiducial in record.fiducials])
    return placed_um(record, board) - placed_um(previous, board)


def since(record: AlignmentRecord, previous: AlignmentRecord) -> str:
    """Say how far the board moved."""
    most = float(np.linalg.norm(_apart_um(record, previous), axis=1).max())
    return f"the fiducials moved by up to {most:.1f} um, turned by {record.theta_deg - previous.theta_deg:+.4f} deg."


def _drift(record: AlignmentRecord, previous: AlignmentRecord) -> Plot:
    apart = _apart_um(record, previous)
    times, svg = _fiducials(record, apart, SECOND, "new minus previous")
    lengths = np.linalg.norm(apart, axis=1)
    caption = (
        f"By how much each fiducial is put elsewhere than by the previous alignment: {float(lengths.max()):.1f} um at "
        f"most. Turn {record.theta_deg - previous.theta_deg:+.4f}°, scale {_ppm(record) - _ppm(previous):+.0f} ppm. "
        f"Arrows magnified {times} times. A board that was put in again lies elsewhere; that is no fault."
    )
    return Plot("Change since the previous calibration", svg, caption)


def _fiducials(record: AlignmentRecord, away_um: Array, colour: str, what: str) -> tuple[int, Markup]:
    """Draw the fiducials with arrows; return the magnification and the figure."""
    at = np.array([fiducial.robot_um for fiducial in record.fiducials]) / 1e3
    figure, (axes,) = new_figure(height_in=5.0)
    size = float(max(np.ptp(at, axis=0).max(), 1.0))
    longest = float(np.linalg.norm(away_um, axis=1).max()) / 1e3
    times = next((m for m in MAGNIFIED if m * longest <= 0.2 * size), 1)
    axes.plot(*at.T, "o", color=INK, markersize=8, markerfacecolor="none", markeredgewidth=1.4)
    axes.quiver(*at.T, *(away_um * times / 1e3).T, color=colour, angles="xy", scale_units="xy", scale=1.0, width=0.003)
    for fiducial, place, away in zip(record.fiducials, at, away_um, strict=True):
        text = f"{fiducial.name}\n{math.hypot(*away):.1f} um"
        axes.annotate(text, place, xytext=(9, 6), textcoords="offset points", fontsize=9, color=INK)
    axes.set(xlabel="X, mm", ylabel="Y, mm", aspect="equal", title=f"{what}, {TIMES}{times}")
    axes.margins(0.25)
    return times, to_svg(figure, f"Fiducials with arrows, {what}")
