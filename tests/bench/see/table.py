"""The bench's tables: verdicts and accuracy by kind, times and their ratios, the old way and OpenCV's matchers."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

Row = dict[str, Any]

DECIDED, NEAR_UM = 9.2, 100.0
"""Log odds of a place that the picture decides for; what is nearer to the truth is the right place."""
THRESHOLDS = (0.3, 0.4, 0.45, 0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9)


def print_all(rows: list[Row]) -> None:
    """Print every table."""
    print_verdicts(rows)
    print_roc(rows)
    print_times(rows)
    print_peers(rows)


def _groups(rows: Iterable[Row]) -> dict[str, list[Row]]:
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(f"{row['kind']}", []).append(row)
    return groups


def print_verdicts(rows: list[Row]) -> None:
    print(f"{'kind':20} {'frames':>6} {'right':>6} {'wrong':>6} {'refused':>7} {'rms px':>7} {'p99 px':>7} "
          f"{'norm.':>6} {'agree p5':>8}  refused as")  # fmt: skip
    for kind, group in _groups(rows).items():
        count = {v: sum(row["verdict"] == v for row in group) for v in ("right", "wrong", "refused")}
        right = [row for row in group if row["verdict"] == "right"]
        off = np.array([row["off_px"] for row in right])
        print(f"{kind:20} {len(group):6} {count['right']:6} {count['wrong']:6} {count['refused']:7} "
              f"{_rms(off):7.3f} {_quantile(off, 99):7.2f} {_normalised(right):6.2f} "
              f"{_quantile(np.array([row['agreement'] for row in right]), 5):8.2f}  {_reasons(group)}")  # fmt: skip


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


def _quantile(values: np.ndarray, percent: float) -> float:
    return float(np.percentile(values, percent)) if len(values) else float("nan")


def _normalised(right: list[Row]) -> float:
    """Return the root mean square of the error in its own sigmas; 1 is honest."""
    return float(np.sqrt(np.mean([row["mahalanobis2"] for row in right]) / 2.0)) if right else float("nan")


def _reasons(group: list[Row]) -> str:
    counts: dict[str, int] = {}
    for row in group:
        if row["verdict"] == "refused":
            name = row.get("named") or row["reason"]
            counts[name] = counts.get(name, 0) + 1
    return ", ".join(f"{name} {number}" for name, number in sorted(counts.items(), key=lambda item: -item[1]))


def print_roc(rows: list[Row]) -> None:
    """Print what each threshold alone would let pass: right places, and all else that the picture alone decides for."""
    judged = [row for row in rows if "agreement" in row and row["log_odds"] >= DECIDED]
    right = [row for row in judged if row["has_answer"] and row["off_um"] < NEAR_UM]
    other = [row for row in judged if not row["has_answer"] or row["off_um"] >= NEAR_UM]
    print(f"\nlet pass by each threshold alone, of {len(right)} looks at the right place and {len(other)} elsewhere")
    for name, value in (("agreement", lambda row: row["agreement"]), ("edges near", lambda row: row["near"][0]),
                        ("metal seen", lambda row: row["metal_seen"])):  # fmt: skip
        parts = [f"{t:.2f}: {sum(value(r) >= t for r in right)} / {sum(value(r) >= t for r in other)}"
                 for t in THRESHOLDS]  # fmt: skip
        print(f"{name:11} " + ", ".join(parts))
    both = [f"{t:.2f}: {sum(_both(r, t) for r in right)} / {sum(_both(r, t) for r in other)}" for t in THRESHOLDS]
    print(f"{'agreement with edges near 0.5':11} " + ", ".join(both))


def _both(row: Row, threshold: float) -> bool:
    return bool(row["agreement"] >= threshold and row["near"][0] >= 0.5)


def print_times(rows: list[Row]) -> None:
    """Print medians, ms, and ratios of frames in which all was measured."""
    print()
    for board in sorted({row["board"] for row in rows}):
        group = [row for row in rows if row["board"] == board]
        times = {name: _median(group, name) for name in ("prepare_ms", "register_ms", "follow_ms", "explain_ms",
                                                        "tdea_ms", "hough_ms")}  # fmt: skip
        line = ", ".join(f"{name[:-3]} {value:.1f}" for name, value in times.items() if not np.isnan(value))
        both = [row for row in group if "tdea_ms" in row and row["verdict"] == "right"]
        ratios = ""
        if both:
            ratios = "; register / TDEA {:.2f}, / Hough {:.1f}; follow / TDEA {:.2f}".format(
                np.median([row["register_ms"] / row["tdea_ms"] for row in both]),
                np.median([row["register_ms"] / row["hough_ms"] for row in both]),
                np.median([row["follow_ms"] / row["tdea_ms"] for row in both]),
            )
        print(f"{board}: median ms {line}{ratios}")


def _median(rows: list[Row], name: str) -> float:
    values = [row[name] for row in rows if name in row]
    return float(np.median(values)) if values else float("nan")


def print_peers(rows: list[Row]) -> None:
    """Print who else found the target in the same frames."""
    compared = [row for row in rows if "tdea_ms" in row]
    if not compared:
        return
    print()
    for kind, group in _groups(compared).items():
        rounds = [row for row in group if "old" in row]
        if rounds:
            line = ", ".join(f"{v} {sum(row['old'] == v for row in rounds)}" for v in ("right", "wrong", "refused"))
            new = ", ".join(f"{v} {sum(row['verdict'] == v for row in rounds)}" for v in ("right", "wrong", "refused"))
            print(f"{kind}: round targets {len(rounds)}: constellation {line}; registration {new}")
        for name in ("match_template", "phase", "ecc"):
            off = np.array([row[f"{name}_off_px"] for row in group])
            near = off[off < 8.0]
            print(f"{kind}: {name:15} within 8 px {len(near)} of {len(off)}, rms {_rms(near):.2f} px, "
                  f"{_median(group, f'{name}_ms'):.1f} ms")  # fmt: skip
