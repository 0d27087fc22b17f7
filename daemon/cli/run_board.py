"""`reprobe run`: a board tested by a plan."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from daemon.cli.board_run import run_over_board
from daemon.cli.output import DEFAULT_ENDPOINT, USAGE, Endpoint, fail

app = typer.Typer()
EITHER = (
    "`reprobe run PLAN --board-id ID` has a running daemon test a board by a plan; "
    "`reprobe serve --config station.toml` runs the daemon"
)


@app.command()
def run(
    plan: Annotated[
        str | None, typer.Argument(help="A plan's file (TOML or CSV), or the name of a stored one.")
    ] = None,
    board_id: Annotated[str | None, typer.Option("--board-id", help="Which board lies in the nest.")] = None,
    point: Annotated[list[str] | None, typer.Option(help="Instead of a plan: a test point; may be repeated.")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with this board's unfinished run.")] = False,
    abandon: Annotated[bool, typer.Option("--abandon", help="End its unfinished run, and begin another.")] = False,
    order: Annotated[
        Literal["short", "given"], typer.Option(help="By shortest time, or as the plan has it.")
    ] = "short",
    stop_failed: Annotated[int | None, typer.Option(min=1, help="Stop after so many points that failed.")] = None,
    stop_contact: Annotated[
        int, typer.Option(min=0, help="Stop after so many in a row without contact; 0: never.")
    ] = 5,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    config: Annotated[Path | None, typer.Option("--config", "-c", hidden=True)] = None,
    as_json: Annotated[bool, typer.Option("--json", help="JSON lines: of points and result.")] = False,
) -> None:
    """Test a board by a plan, and show each point as it is done.

    Exit code 0: every point passed, at once or recovered. 1: a net is at fault, or the run stopped. 3: some points are
    not known, and none is at fault.
    """
    if config is not None:  # what `reprobe serve` was called
        if plan is not None or board_id is not None or resume or point:
            fail("a plan and --config do not go together", advice=EITHER, code=USAGE)
        from daemon.cli.serve import run_daemon  # noqa: PLC0415  # the daemon itself: only for this

        run_daemon(config, as_json=as_json)
        return
    if plan is None and not resume and not point:
        fail("say what to test: a plan, --point or --resume", advice=EITHER, code=USAGE)
    if board_id is None:
        fail(
            "say which board lies in the nest: --board-id, its serial number for example",
            advice="touches of its pads are counted by it, and an interrupted run is found again",
            code=USAGE,
        )
    stop = {"contact_not_made": stop_contact or None, "failed": stop_failed}
    run_over_board(
        plan, endpoint, as_json=as_json, board_id=board_id, points=point, resume=resume, abandon=abandon, order=order,
        stop=stop,
    )  # fmt: skip
