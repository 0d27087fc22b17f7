"""`reprobe calibrate ...` and `reprobe align`: one command for each calibration, with a progress bar."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from daemon.cli.click_page import kept_picture, write_click_page
from daemon.cli.fit import fit
from daemon.cli.formatting import age
from daemon.cli.output import DEFAULT_ENDPOINT, FAILED, AsJson, Endpoint, answered, err, out
from daemon.cli.points import point_option
from daemon.cli.progress import run_with_bar
from daemon.cli.study import certificate, page
from daemon.client import Client
from daemon.storage.calibration_in_force import OF_THE_PROBE

app = typer.Typer()
group = typer.Typer(help="Calibrate: tip, map, rotation, surface, backlash.", no_args_is_help=True)
app.add_typer(group, name="calibrate")
group.command("fit")(fit)
group.command("page")(page)
group.command("certificate")(certificate)
Theta = Annotated[float, typer.Option(help="Head angle, degrees.")]
On = Annotated[
    str | None, typer.Option(help="Name of a round target that stands alone; the printed control point by default.")
]


@group.command()
def tip(
    tip_px: Annotated[str | None, typer.Option("--tip", help="The needle's end in the picture, X,Y in px.")] = None,
    page: Annotated[Path, typer.Option(help="Without --tip: where to put the page to click on.")] = Path("tip.html"),
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """Teach the probe's tip from a white picture: say where its end is, or get a page on which to click it.

    A new probe makes map, rotation and surface void: its end lies elsewhere.
    """
    place = None if tip_px is None else point_option(tip_px, "--tip", FAILED)
    if not as_json:
        with answered(), Client(endpoint) as client:
            _say_void(client.request("status"))
    if place is not None:
        run_with_bar("calibrate", endpoint, as_json=as_json, what="tip", tip_px=place)
        return
    with answered(), Client(endpoint) as client:
        result = client.job("look", pictures=True)
    if result.pictures is None:
        raise typer.Exit(FAILED)
    write_click_page(kept_picture(Path(result.pictures) / "before-white.jpg"), page)
    out.print(
        f"open {page}, click the very end of the needle, and run the command it shows", markup=False, soft_wrap=True
    )


def _say_void(status: Mapping[str, Any]) -> None:
    """Say what will be void, before anything is taught."""
    made = (status.get("calibration") or {}).get("made_at") or {}
    void = [f"{what} (made {age(made[what])})" for what in OF_THE_PROBE if what in made]
    if void:
        err.print(f"a new tip makes void: {', '.join(void)}; they are measured again", highlight=False, soft_wrap=True)


@group.command("map")
def map_(
    on: On = None,
    theta_deg: Theta = 0.0,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """Calibrate the map from image to robot."""
    run_with_bar("calibrate", endpoint, as_json=as_json, what="map", theta_deg=theta_deg, **_on(on))


@group.command()
def rotation(
    angles: Annotated[int | None, typer.Option(help="So many head angles, evenly spread (32).")] = None,
    every: Annotated[float | None, typer.Option(help="Instead: at every so many degrees.")] = None,
    model: Annotated[
        Literal["auto", "fourier", "array", "circle"],
        typer.Option(help="What to fit; auto takes what predicts angles left out best."),
    ] = "auto",
    anew: Annotated[bool, typer.Option("--anew", help="Do not go on with an interrupted run.")] = False,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """Calibrate the head's rotation on the printed control point."""
    fields: dict[str, Any] = {"model": model, "resume": not anew}
    if angles is not None:
        fields["angles"] = angles
    if every is not None:
        fields["every_deg"] = every
    run_with_bar("calibrate", endpoint, as_json=as_json, what="rotation", **fields)


@group.command()
def surface(
    places: Annotated[int, typer.Option(min=4, max=200, help="How many test points to touch.")] = 12,
    theta_deg: Theta = 0.0,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """Touch test points at random and say whether they lie in a plane, and how high it is."""
    run_with_bar("calibrate", endpoint, as_json=as_json, what="surface", places=places, theta_deg=theta_deg)


@group.command()
def backlash(
    on: On = None, theta_deg: Theta = 0.0, endpoint: Endpoint = DEFAULT_ENDPOINT, as_json: AsJson = False
) -> None:
    """Measure the play of X and Y."""
    run_with_bar("calibrate", endpoint, as_json=as_json, what="backlash", theta_deg=theta_deg, **_on(on))


@app.command()
def align(
    on: Annotated[
        list[str] | None, typer.Option(help="A round target to look at; repeat it. The board's fiducials by default.")
    ] = None,
    theta_deg: Annotated[
        list[float] | None, typer.Option(help="A head angle to look from; repeat it. 0 and 180 by default.")
    ] = None,
    board_id: Annotated[
        str | None, typer.Option("--board-id", help="Which board lies in the nest; later jobs may name it.")
    ] = None,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """See which board lies in the nest, and where: from places that are found once on it, or from round targets."""
    fields: dict[str, Any] = {} if board_id is None else {"board_id": board_id}
    if on:
        fields["fiducials"] = on
    if theta_deg:
        fields["thetas_deg"] = theta_deg
    run_with_bar("align", endpoint, as_json=as_json, **fields)


def _on(name: str | None) -> dict[str, Any]:
    return {} if name is None else {"test_point": name}
