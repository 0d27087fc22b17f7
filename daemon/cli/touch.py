"""Commands that touch: `reprobe touch`, which may hold the needle down, and `reprobe lift`, which ends that."""

from __future__ import annotations

import select
import sys
from contextlib import suppress
from typing import Annotated, Any

import typer

from daemon.cli.interruption import taken_as_ctrl_c
from daemon.cli.output import DEFAULT_ENDPOINT, AsJson, Endpoint, answered, err, fail, out, say_json
from daemon.cli.tester import ANSWER_WITHIN_S, BoardId, JobIdOption, run_job, show
from daemon.client import Client, Refused, StandsAgain
from daemon.domain.results import JobResult

app = typer.Typer()
LONGEST_MS = 600_000.0
"""What one touch may hold."""
LEASE_MS, RENEW_S = 2000.0, 0.5


@app.command()
def touch(
    test_point: Annotated[str, typer.Argument(help="Name of the test point over which the head was put just before.")],
    hold: Annotated[bool, typer.Option("--hold", help="Hold the needle down until Enter, Ctrl-C or a lift.")] = False,
    press_um: Annotated[float | None, typer.Option(help="How far the pin is to be pushed in, um.")] = None,
    board_id: BoardId = None,
    job_id: JobIdOption = None,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """Lower the needle onto the test point below it, and lift it again."""
    fields: dict[str, Any] = {"press_um": press_um, "board_id": board_id}
    if not hold:
        run_job("touch", endpoint, as_json=as_json, job_id=job_id, test_point=test_point, **fields)
        return
    given = {name: value for name, value in fields.items() if value is not None}
    with answered():
        show(_held(endpoint, test_point, job_id, given, as_json=as_json), as_json=as_json)


def _held(endpoint: str, test_point: str, job_id: str | None, given: dict[str, Any], *, as_json: bool) -> JobResult:
    """Touch, hold until somebody wants the needle up, and return the touch's result."""
    with taken_as_ctrl_c():
        with Client(endpoint, timeout_s=ANSWER_WITHIN_S) as client:
            client.request("status")
            contact = client.touch(test_point, job_id=job_id, hold_ms=LONGEST_MS, lease_ms=LEASE_MS, **given)
            try:
                _tell(contact, as_json=as_json)
                _keep_down(client, contact["id"])
            except KeyboardInterrupt:
                err.print("lifting ...")
        # A new connection: what interrupted the old one may have left it waiting for an answer.
        with Client(endpoint, timeout_s=ANSWER_WITHIN_S) as client:
            return client.lift(contact["id"])


def _tell(contact: dict[str, Any], *, as_json: bool) -> None:
    if as_json:
        say_json({"contact": contact})
        return
    how = "Enter lifts it" if sys.stdin.isatty() else "`reprobe lift`, or the end of this command, lifts it"
    out.print(
        f"the needle stands on {contact['test_point']}: pushed in by {contact['pressed_um']:.0f} um, "
        f"{contact['force_n']:.2f} N (press {contact.get('press', 1)}); {how}",
        highlight=False,
    )


def _keep_down(client: Client, touch_id: str) -> None:
    """Renew the lease until Enter is pressed, or the needle is not held any more."""
    with suppress(Refused):
        while not _enter_within(RENEW_S):
            client.hold(touch_id, LEASE_MS)


def _enter_within(seconds: float) -> bool:
    """Wait; return whether somebody pressed Enter. Without a terminal nobody can."""
    ready, _, _ = select.select([sys.stdin] if sys.stdin.isatty() else [], [], [], seconds)
    if ready:
        sys.stdin.readline()
    return bool(ready)


@app.command()
def lift(
    verdict: Annotated[str | None, typer.Option(help="What the tester says of the point it touched.")] = None,
    value: Annotated[float | None, typer.Option(help="What it measured.")] = None,
    unit: Annotated[str | None, typer.Option(help="Of the value.")] = None,
    press: Annotated[
        int | None, typer.Option(min=1, help="In which press it was measured; none: the one that stands now.")
    ] = None,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """End the touch that holds the needle down; where none does, raise the needle straight up to the safe height."""
    given = {"verdict": verdict, "value": value, "unit": unit}
    measured: dict[str, Any] = {name: said for name, said in given.items() if said is not None}
    with answered(), Client(endpoint, timeout_s=ANSWER_WITHIN_S) as client:
        contact = client.request("snapshot")["contact"]
        if contact is not None:
            try:
                show(client.lift(contact["id"], press=press or contact.get("press"), **measured), as_json=as_json)
                if measured and not as_json:
                    out.print(
                        f"noted: {' '.join(str(said) for said in measured.values())}", markup=False, highlight=False
                    )
            except StandsAgain as again:
                _tell(again.contact, as_json=as_json)
            return
    if measured or press is not None:
        fail("no touch holds the needle down", advice="`reprobe touch TP7 --hold` does; what was measured is told then")
    run_job("lift", endpoint, as_json=as_json, press=press, **measured)
