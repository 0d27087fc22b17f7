"""Image points as arguments of the command line."""

from __future__ import annotations

import math

from daemon.cli.output import USAGE, fail


def parse_point(text: str) -> tuple[float, float]:
    """Return X,Y as two finite numbers, px; ValueError for anything else."""
    parts = text.split(",")
    if len(parts) != 2:
        raise ValueError(f"{text!r} is not X,Y: two numbers, a comma between them")
    try:
        x_px, y_px = (float(part) for part in parts)
    except ValueError:
        raise ValueError(f"{text!r} is not X,Y: two numbers, a comma between them") from None
    if not (math.isfinite(x_px) and math.isfinite(y_px)):
        raise ValueError(f"{text!r} is no place")
    return x_px, y_px


def point_option(text: str, option: str, code: int = USAGE, *, example: str = "428.0,620.5") -> tuple[float, float]:
    """Return the point an option gives, or end with a message that names the option."""
    try:
        return parse_point(text)
    except ValueError as exc:
        fail(f"{option} {exc}", advice=f"for example {option} {example}", code=code)
