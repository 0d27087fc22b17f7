"""Command that tests one point: `reprobe probe TP7`, or `reprobe probe --net VCC`; its exit code is the verdict."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import typer
from pydantic import ValidationError
from rich.markup import escape

from daemon.cli.formatting import as_commands
from daemon.cli.output import DEFAULT_ENDPOINT, USAGE, AsJson, Endpoint, answered, err, fail, out, say_cure, say_json
from daemon.cli.probe_tester import probe_for_tester
from daemon.cli.tester import ANSWER_WITHIN_S, BoardId, JobIdOption
from daemon.client import Client
from daemon.config.plan_units import parse_value
from daemon.domain.point_test import PASSES, UNIT_OF_METHOD, Limits, PointRecord, PointUnit, PointVerdict
from daemon.domain.results import JobResult

app = typer.Typer()
OWN = {"station": "station's instrument", "tester": "tester"}
ACCUSED, NOT_KNOWN = 1, 3
"""Exit codes beside 0, a pass, and 2, a wrong command: the net is at fault; or nobody knows, for it was not tested."""
PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "u"), (1e-9, "n"), (1e-12, "p"))


@app.command()
def probe(
    test_point: Annotated[str | None, typer.Argument(help="Name of the test point, as the board file has it.")] = None,
    net: Annotated[str | None, typer.Option(help="Instead of a point: the best point of this net.")] = None,
    method: Annotated[str, typer.Option(help="contact, continuity, resistance, fres, voltage, diode, capacitance.")] = (
        "continuity"
    ),
    low: Annotated[str | None, typer.Option(help='Lowest value that passes: 800, or "0.8 kohm".')] = None,
    high: Annotated[str | None, typer.Option(help="Highest value that passes.")] = None,
    unit: Annotated[str | None, typer.Option(help="Of the limits: ohm, V or F; the method's own by default.")] = None,
    theta: Annotated[float | None, typer.Option(help="Head angle, degrees; any that reaches it by default.")] = None,
    look_first: Annotated[bool, typer.Option("--look-first", help="Look before the first touch.")] = False,
    touches: Annotated[int | None, typer.Option(help="Descents onto the pad at most.")] = None,
    measure: Annotated[
        Literal["station", "tester"],
        typer.Option(help="Who measures. tester: you do, and a line per press says pass, fail, open, or a value."),
    ] = "station",
    timeout_s: Annotated[float, typer.Option(help="Give up after this.")] = 60.0,
    board_id: BoardId = None,
    job_id: JobIdOption = None,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """Test one point: place, touch, measure; where that is no pass look, correct and pump before anybody is accused.

    Exit code 0: it passes; 1: it fails, or is open, with proof; 3: no contact was made, or it was not tested.
    """
    if (test_point is None) == (net is None):
        fail("give either a test point or --net", advice="reprobe probe TP7, or reprobe probe --net VCC", code=USAGE)
    known = [name for name in UNIT_OF_METHOD if name != "insert" or measure == "tester"]
    if method not in known:
        fail(f"{method!r} is no method of the {OWN[measure]}", advice=f"one of {', '.join(known)}", code=USAGE)
    fields: dict[str, Any] = {
        "test_point": test_point, "net": net, "method": method, "theta_deg": theta, "touches": touches,
        "board_id": board_id, "look": "first" if look_first else None, "deadline_ms": timeout_s * 1e3,
        "limits": limits_of(method, low, high, unit),
    }  # fmt: skip
    given = {name: value for name, value in fields.items() if value is not None}
    by_tester = measure == "tester"
    _show(_answer(endpoint, job_id, timeout_s, given, by_tester=by_tester, as_json=as_json), as_json=as_json)


def _answer(
    endpoint: str, job_id: str | None, timeout_s: float, given: dict[str, Any], *, by_tester: bool, as_json: bool
) -> JobResult:
    """Return the job's result; who gets none has no verdict, and the exit code must not look like one."""
    try:
        if by_tester:
            with answered():
                return probe_for_tester(endpoint, job_id, timeout_s + 10.0, given, as_json=as_json)
        with answered(), Client(endpoint, timeout_s=ANSWER_WITHIN_S) as client, err.status("probe ..."):
            client.request("status")
            return client.job("probe", job_id=job_id, timeout_s=timeout_s + 10.0, **given)
    except KeyboardInterrupt:
        # Another exit code would say that the net is at fault.
        err.print("interrupted: not tested" if by_tester else "interrupted; `reprobe cancel` ends the job")
        raise typer.Exit(NOT_KNOWN) from None
    except typer.Exit:
        raise typer.Exit(NOT_KNOWN) from None


def limits_of(method: str, low: str | None, high: str | None, unit: str | None) -> dict[str, Any] | None:
    """Return the limits as the wire has them; None where none are given."""
    if low is None and high is None:
        return None
    own = next(of for name, of in UNIT_OF_METHOD.items() if name == method)
    if own is None:
        fail(f"{method} measures no value, so it has no limits", advice="leave --low and --high out", code=USAGE)
    ends = {name: _limit(name, text, own) for name, text in (("low", low), ("high", high)) if text is not None}
    try:
        limits = Limits.model_validate({**ends, "unit": unit or own})
    except ValidationError as exc:
        what = exc.errors(include_input=False)[0]["msg"].removeprefix("Value error, ")
        fail(f"limits: {what}", advice="low at most high, and unit ohm, V or F", code=USAGE)
    if limits.unit != own:
        fail(f"{method} is measured in {own}, and the limits are in {limits.unit}", code=USAGE)
    return limits.model_dump(exclude_none=True)


def _limit(name: str, text: str, own: PointUnit) -> float:
    """Return a limit's value; a number without a unit is in that of `--unit`, or in the method's own."""
    try:
        return float(text)
    except ValueError:
        pass
    try:
        return parse_value(text, own)
    except ValueError as exc:
        fail(f"--{name}: {exc}", code=USAGE)


def _show(result: JobResult, *, as_json: bool) -> None:
    """Show what came of the point, and exit by it."""
    if as_json:
        say_json(result.model_dump(mode="json"))
    elif result.error is not None:
        why = f"{result.error.name} ({result.error.code}), {escape(as_commands(result.error.message))}"
        out.print(f"[red]not tested[/]: {why}", highlight=False, soft_wrap=True)
        say_cure(result.error.advice)
    else:
        for line in told(PointRecord.model_validate(result.detail["record"])):
            out.print(line, highlight=False, soft_wrap=True)
    code = exit_code(result)
    if code:
        raise typer.Exit(code)


def exit_code(result: JobResult) -> int:
    """Return 0 for a pass, 1 for a net that is at fault, 3 where that is not known."""
    if not result.ok or result.outcome in (PointVerdict.CONTACT_NOT_MADE, PointVerdict.NOT_TESTED):
        return NOT_KNOWN
    return 0 if result.outcome in PASSES else ACCUSED


def told(record: PointRecord) -> list[str]:
    """Return a record in lines for a person: the verdict, how it came to it, and each press."""
    passed, known = record.verdict in PASSES, record.verdict in (PointVerdict.FAIL, PointVerdict.OPEN_CONFIRMED)
    colour = "green" if passed else "red" if known else "yellow"
    net = f" ({escape(record.net)})" if record.net else ""
    how = ""
    if record.recovered_by is not None:
        how = f", recovered by {record.recovered_by.replace('_', ' ')}"
        how += f": it was {_CAUSES[record.cause]}" if record.cause in _CAUSES else ""
    verdict = record.verdict.replace("_", " ")
    counts = ", ".join(
        f"{n} {one if n == 1 else many}"
        for n, one, many in (
            (record.touches, "touch", "touches"), (record.presses, "press", "presses"), (record.looks, "look", "looks")
        )
    )  # fmt: skip
    counts += f", {record.seconds:.1f} s"
    lines = [f"[{colour}]{verdict}[/] {escape(record.point)}{net}{how}; {counts}"]
    if record.reason:
        lines.append(f"  {escape(record.reason)}")
    for reading in record.readings:
        value = reading.said if reading.value is None else si(reading.value, reading.unit)
        value = "overload" if reading.overload else value
        wanted = _wanted(record) if record.verdict is PointVerdict.FAIL else ""
        proof = {True: ", contact proved", False: ", no contact", None: ""}[reading.proof]
        lines.append(
            f"  {reading.rung.replace('_', ' '):<12} {value or 'nothing read'}{wanted} "
            f"at {reading.force_n:.2f} N{proof}"
        )
    return lines


def _wanted(record: PointRecord) -> str:
    """Return the limits that a reading had to keep, in words; nothing where there are none."""
    limits = record.limits
    if limits is None:
        return ""
    low, high = (None if one is None else si(one, limits.unit) for one in (limits.low, limits.high))
    if low is not None and high is not None:
        return f" (wanted: {low} to {high})"
    return f" (wanted: {'at least ' + low if low is not None else 'at most ' + str(high)})"


_CAUSES = {"misplaced": "misplaced", "film": "a film", "needle": "the needle"}


def si(value: float, unit: str | None = None) -> str:
    """Return a value with three digits and its unit, with the prefix of its size: 185 mohm."""
    factor, prefix = next(((f, p) for f, p in PREFIXES if abs(value) >= f), (1.0, ""))
    return f"{value / factor:.3g} {prefix}{unit or ''}".strip()
