"""Report of a demonstration: every landing with its images, and the errors as a plot."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, select_autoescape

from daemon.domain.board import Board
from daemon.platform.clock import WAITS
from daemon.tools.demo.session import LIMIT_UM, Landing

_PLOT_WIDTH, _PLOT_HEIGHT, _PLOT_MARGIN = 760.0, 260.0, 46.0


def write_report(out: Path, board: Board, seed: int, landings: list[Landing]) -> Path:
    """Write index.html into `out` and return its path; pictures are linked, not copied."""
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=select_autoescape(),
        trim_blocks=True,
        lstrip_blocks=True,
    )
    path = out / "index.html"
    path.write_text(
        environment.get_template("report.html.j2").render(
            board=board,
            seed=seed,
            limit_um=LIMIT_UM,
            landings=[_story(landing, out) for landing in landings],
            good=sum(landing.good for landing in landings),
            plot=_plot(landings),
            waits=WAITS,
        )
    )
    return path


def _story(landing: Landing, out: Path) -> dict[str, Any]:
    """Gather what the page says of one landing."""
    folder = Path(landing.result.pictures).resolve() if landing.result.pictures else None
    pictures = [
        (name, what, file.relative_to(out.resolve()))
        for what in ("tip", "pads")
        for name in ("before", "after")
        if folder and (file := folder / f"{name}-{what}.jpg").exists()
    ]
    software_ms = sum(row["software"] for row in landing.result.timing_ms.values())
    return {"landing": landing, "result": landing.result, "pictures": pictures, "software_ms": software_ms}


def _plot(landings: list[Landing]) -> dict[str, Any]:
    """Lay out the error plot: a pair of bars a point, on one linear axis in um."""
    top_um = max([LIMIT_UM * 1.2, *(x.before_um for x in landings if x.before_um < 1e6)])
    inner_width, inner_height = _PLOT_WIDTH - 2 * _PLOT_MARGIN, _PLOT_HEIGHT - 2 * _PLOT_MARGIN

    def y(um: float) -> float:
        return round(_PLOT_HEIGHT - _PLOT_MARGIN - min(um, top_um) / top_um * inner_height, 1)

    slot = inner_width / max(1, len(landings))
    bars = [
        {"x": round(_PLOT_MARGIN + k * slot, 1), "width": round(slot * 0.36, 1), "name": x.point.name,
         "before_y": y(x.before_um), "after_y": y(x.after_um), "before_um": x.before_um, "after_um": x.after_um}
        for k, x in enumerate(landings)
    ]  # fmt: skip
    step = 50 if top_um <= 300 else 100 if top_um <= 800 else 500
    ticks = [{"um": um, "y": y(um)} for um in range(0, int(top_um) + 1, step)]
    return {"width": _PLOT_WIDTH, "height": _PLOT_HEIGHT, "margin": _PLOT_MARGIN, "bars": bars, "ticks": ticks,
            "limit_y": y(LIMIT_UM), "base_y": y(0.0)}  # fmt: skip
