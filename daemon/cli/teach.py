"""`reprobe teach`: a probe model from a stored white image."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.markup import escape

from daemon.cli.output import USAGE, AsJson, fail, out, say_json
from daemon.cli.picture_files import Pixels, check_place, check_target, keep, open_picture, write_picture
from daemon.cli.points import point_option
from daemon.cli.vision_output import facts_table, number, numbers
from vision import NotFound, ProbeModel, Tip, find_tip
from vision.annotate import draw_tip, draw_untaught

app = typer.Typer()
MOST_OFF_PX = 0.5
"""A probe that is not found again this near in its own picture is not worth keeping."""


@app.command()
def teach(
    white: Annotated[Path, typer.Option(help="Stored white picture, the needle's end before a dark, quiet ground.")],
    tip: Annotated[str, typer.Option(help="The needle's very end in it, X,Y in px.")],
    model_file: Annotated[Path, typer.Option("--out", "-o", help="Write the probe here (.npz).")],
    annotated: Annotated[Path | None, typer.Option(help="Write an annotated picture here.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a probe that is there.")] = False,
    as_json: AsJson = False,
) -> None:
    """Teach a probe from a stored white picture, check that it is found again, and write it."""
    click = point_option(tip, "--tip")
    check_place(model_file, [white])
    if annotated is not None:
        check_target(annotated, [white, model_file])
    if model_file.exists() and not force:
        fail(f"{model_file} is there already", advice="add --force to replace it", code=USAGE)
    picture = open_picture(white)
    height, width = picture.shape[:2]
    if not (0.0 <= click[0] <= width - 1 and 0.0 <= click[1] <= height - 1):
        fail(f"--tip {tip} lies outside the picture", advice=f"it has {width} x {height} px", code=USAGE)
    model = _teach(picture, click, annotated)
    again = find_tip(picture, model)
    if annotated is not None:
        write_picture(annotated, draw_tip(picture, again, taught=model))
    off_px = _off_px(again, model)
    keep(model_file, model.save)
    if as_json:
        said = {"probe": str(model_file), "annotated": annotated and str(annotated)}
        say_json({"ok": True, "white": str(white), **_facts(model), "found_again_off_px": number(off_px), **said})
        return
    _print(model, off_px)
    for name, path in (("probe", model_file), ("annotated picture", annotated)):
        if path is not None:
            out.print(f"{name}: {escape(str(path))}", highlight=False, soft_wrap=True)


def _teach(picture: Pixels, click: tuple[float, float], annotated: Path | None) -> ProbeModel:
    """Return the probe; where it cannot be taught, show the picture with the click and say why."""
    try:
        return ProbeModel.teach(picture, click)
    except ValueError as exc:
        if annotated is not None:
            write_picture(annotated, draw_untaught(picture, click, str(exc)))
        shown = f"see {annotated}" if annotated is not None else "add --annotated teach.png to see where it was looked"
        plain = "; if the click was right, take the picture where nothing bright lies below the needle"
        fail(f"not taught: {exc}", advice=shown + plain)


def _off_px(again: Tip | NotFound, model: ProbeModel) -> float:
    """Return how far off the tip is found in its own picture; end if that is too far."""
    if isinstance(again, NotFound):
        fail(f"not taught: the tip is not found again ({again.reason}): {again.message}")
    off_px = math.hypot(again.x_px - model.tip_px[0], again.y_px - model.tip_px[1])
    if off_px > MOST_OFF_PX:
        fact = f"not taught: the tip is found {off_px:.2f} px off in its own picture (at most {MOST_OFF_PX})"
        fail(fact, advice="take a picture before a dark, quiet ground and click the very end")
    return off_px


def _facts(model: ProbeModel) -> dict[str, Any]:
    shape = model.shape
    return {
        "tip_px": numbers(model.tip_px),
        "h_px": number(model.h_px),
        "marking_px": number(shape.marking_px),
        "end_width_px": number(2.0 * shape.end_half_px),
        "rim_width_px": number(2.0 * _half_at_rim_px(model)),
        "cylinder_width_px": number(2.0 * shape.cylinder_half_px),
        "angle_deg": number(math.degrees(model.angle_rad)),
        "marking_contrast": number(model.marking_contrast),
        "click_beside_axis_px": number(model.click_offset_px),
    }


def _print(model: ProbeModel, off_px: float) -> None:
    shape = model.shape
    table = facts_table("probe")
    table.add_row("tip, on the axis", f"[bold]({model.tip_px[0]:.2f}, {model.tip_px[1]:.2f}) px[/]")
    table.add_row("the click lies beside the axis", f"{model.click_offset_px:+.2f} px")
    table.add_row("h, lower rim to end", f"{model.h_px:.2f} px")
    table.add_row("marking's length, contrast", f"{shape.marking_px:.2f} px, {100 * model.marking_contrast:.0f} %")
    widths = (2.0 * shape.end_half_px, 2.0 * _half_at_rim_px(model), 2.0 * shape.cylinder_half_px)
    table.add_row("width at end, rim, cylinder", ", ".join(f"{width:.1f}" for width in widths) + " px")
    table.add_row("direction", f"{math.degrees(model.angle_rad):.2f} deg")
    table.add_row("found again in its picture", f"[green]{off_px:.2f} px off[/]")
    out.print(table)


def _half_at_rim_px(model: ProbeModel) -> float:
    # Just below the rim, where the taper ends.
    return float(model.shape.half_width(np.array([-model.h_px]))[0])
