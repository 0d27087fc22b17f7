"""The shipped dashboards drawn without Grafana: each query put to the real engines, each panel in its place as HTML.

For who has no Grafana at hand, and to look at a query's answer as it will stand there. Tables, numbers and lines only.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from html import escape
from math import isfinite
from pathlib import Path
from typing import Any

from tests.bench.fleet import ask_named
from tests.fleet.dashboards import dashboards, filled_in
from tests.fleet.engines import PostgreSQL, Prometheus

SPAN_S, STEPS = 180.0, 90
"""Of lines of Prometheus: so long back, in so many steps."""
UNITS = {"percentunit": (100.0, " %"), "um": (1.0, " um"), "s": (1.0, " s")}
COLOURS = ("#2b6cb0", "#c05621", "#2f855a", "#6b46c1", "#b83280", "#975a16", "#2c7a7b", "#c53030", "#4a5568", "#718096")
WIDE, HIGH, LEFT, LOW = 600, 190, 60, 20
STYLE = """
body{font:13px sans-serif;background:#f4f5f5;margin:8px;display:grid;grid-template-columns:repeat(24,1fr);
grid-auto-rows:34px;gap:6px} h1{grid-column:1/25;grid-row:1;font-size:18px;margin:4px}
section{background:#fff;border:1px solid #ddd;padding:6px;overflow:hidden} h2{font-size:13px;margin:0 0 4px}
table{border-collapse:collapse;width:100%;font-size:11px}
td,th{text-align:left;padding:1px 6px;border-bottom:1px solid #eee;
white-space:nowrap} b{font-size:30px;margin-right:18px} svg{width:100%} i{font-style:normal;margin-right:10px}
"""
Lines = dict[str, list[tuple[float, float]]]


def draw(folder: Path, database: PostgreSQL, prometheus: Prometheus, variables: Mapping[str, str]) -> list[Path]:
    """Write one page a dashboard; return their files."""
    folder.mkdir(parents=True, exist_ok=True)
    written: list[Path] = []
    for board in dashboards():
        panels = "".join(_panel(panel, database, prometheus, variables) for panel in board["panels"])
        named = ", ".join(f"{one['label']}: {variables[one['name']]}" for one in board["templating"]["list"])
        title = escape(f"{board['title']} {named}")
        file = folder / f"{board['uid']}.html"
        file.write_text(f"<!doctype html><meta charset=utf-8><title>{title}</title><style>{STYLE}</style>"
                        f"<h1>{title}</h1>{panels}")  # fmt: skip
        written.append(file)
    return written


def _panel(panel: dict[str, Any], database: PostgreSQL, prometheus: Prometheus, variables: Mapping[str, str]) -> str:
    at, unit = panel["gridPos"], panel["fieldConfig"]["defaults"].get("unit", "")
    place = f"grid-column:{at['x'] + 1}/span {at['w']};grid-row:{at['y'] + 2}/span {at['h']}"
    rows: list[dict[str, Any]] = []
    lines: Lines = {}
    for target in panel["targets"]:
        if target["datasource"]["type"] == "postgres":
            rows += ask_named(database, filled_in(target["rawSql"], variables))
        elif panel["type"] == "timeseries":
            query, legend = filled_in(target["expr"], variables), target["legendFormat"]
            lines |= {_legend(legend, labels): points for labels, points in prometheus.ask_over(query, SPAN_S, STEPS)}
        else:
            found = prometheus.ask(filled_in(target["expr"], variables))
            rows += [{**labels, "value": value} for labels, value in found]
    for row in rows if panel["type"] == "timeseries" else ():
        lines.setdefault(str(row["metric"]), []).append((row["time"].timestamp(), float(row["value"])))
    kinds = {"stat": lambda: _stat(rows), "table": lambda: _table(rows), "timeseries": lambda: _plot(lines, unit)}
    return f"<section style='{place}'><h2>{escape(panel['title'])}</h2>{kinds[panel['type']]()}</section>"


def _legend(pattern: str, labels: Mapping[str, str]) -> str:
    if pattern == "__auto":
        return ", ".join(f"{name}={value}" for name, value in labels.items() if name != "__name__") or "value"
    for name, value in labels.items():
        pattern = pattern.replace(f"{{{{{name}}}}}", value)
    return pattern


def _stat(rows: Sequence[Mapping[str, Any]]) -> str:
    return "".join(f"<b>{_text(value)}</b>{escape(name)} " for row in rows for name, value in row.items()) or "nothing"


def _table(rows: Sequence[Mapping[str, Any]]) -> str:
    if not rows:
        return "nothing"
    names = list(dict.fromkeys(name for row in rows for name in row))
    head = "".join(f"<th>{escape(name)}</th>" for name in names)
    body = "".join("<tr>" + "".join(f"<td>{_text(row.get(name))}</td>" for name in names) + "</tr>" for row in rows)
    return f"<table><tr>{head}</tr>{body}</table>"


def _text(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, datetime):
        return f"{value:%Y-%m-%d %H:%M:%S}"
    return f"{value:.4g}" if isinstance(value, float) else escape(str(value))


def _plot(lines: Lines, unit: str) -> str:
    """Draw lines over their time; one value alone is a dot. Where Prometheus says NaN, nothing was there to count."""
    counted = {name: [(at, value) for at, value in points if isfinite(value)] for name, points in lines.items()}
    lines = {name: points for name, points in counted.items() if points}
    if not lines:
        return "nothing"
    factor, sign = UNITS.get(unit, (1.0, ""))
    times = [at for points in lines.values() for at, _ in points]
    values = [factor * value for points in lines.values() for _, value in points]
    begin, span = min(times), (max(times) - min(times)) or 1.0
    low, high = min(0.0, *values), max(0.0, *values)
    tall = (high - low) or 1.0
    drawn = ""
    for number, points in enumerate(lines[name] for name in sorted(lines)):
        colour = COLOURS[number % len(COLOURS)]
        at = [(LEFT + (WIDE - LEFT - 5) * (x - begin) / span,
               5 + (HIGH - LOW - 5) * (1 - (factor * y - low) / tall)) for x, y in sorted(points)]  # fmt: skip
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in at)
        drawn += f"<polyline points='{path}' fill=none stroke='{colour}' stroke-width=1.5 />"
        drawn += "".join(f"<circle cx={x:.1f} cy={y:.1f} r=3 fill='{colour}' />" for x, y in at if len(at) < 10)
    marks = ((5, high), (HIGH - LOW, low))
    drawn += "".join(f"<text x=0 y={y + 5} font-size=11>{value:.4g}{sign}</text>" for y, value in marks)
    drawn += "".join(
        f"<text x={x} y={HIGH - 3} font-size=11 text-anchor={end}>{datetime.fromtimestamp(at, UTC):%d %H:%M:%S}</text>"
        for x, end, at in ((LEFT, "start", begin), (WIDE, "end", begin + span))
    )
    names = "".join(
        f"<i style='color:{COLOURS[number % len(COLOURS)]}'>{escape(name)}</i>"
        for number, name in enumerate(sorted(lines))
    )
    return f"<svg viewBox='0 0 {WIDE} {HIGH}'>{drawn}</svg><div>{names}</div>"
