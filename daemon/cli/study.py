"""`reprobe study` and `reprobe calibrate page`, `calibrate certificate`: pages about how well a station measures."""

from __future__ import annotations

import asyncio
import errno
import math
import uuid
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from pydantic import BaseModel, ValidationError

from daemon.cli.config_file import ConfigFile, load
from daemon.cli.interruption import taken_as_ctrl_c
from daemon.cli.output import (
    DEFAULT_ENDPOINT,
    FAILED,
    USAGE,
    AsJson,
    Endpoint,
    answered,
    err,
    fail,
    out,
    say_json,
)
from daemon.client import Client, NoAnswer, Refused
from daemon.domain.board import Board
from daemon.platform.atomic_file import written_beside
from daemon.platform.clock import utc_now
from daemon.platform.plain_file import read_small
from daemon.platform.subprocess import draw
from daemon.station.conditions import conditions_of
from daemon.storage.calibration_store import Calibrations

if TYPE_CHECKING:
    from daemon.tools.report.study import Capability

app = typer.Typer()
Trouble = Refused | NoAnswer | KeyboardInterrupt
"""What may end a study early."""
PAGE_WITHIN_S = 120.0
LEAST_LANDINGS = 10
"""As many make a study."""
AWAY_UM = 3000.0
"""The head leaves the point by so much before each landing."""


@app.command()
def study(
    test_point: Annotated[str | None, typer.Argument(help="Name of the test point that is landed on.")] = None,
    times: Annotated[int, typer.Option(min=LEAST_LANDINGS, max=1000, help="How many landings.")] = 50,
    tolerance_um: Annotated[float, typer.Option(min=1.0, help="Tolerance T: the whole width that is allowed.")] = 100.0,
    output: Annotated[Path, typer.Option("--output", "-o", help="The page; the numbers go beside it.")] = Path(
        "study.html"
    ),
    redraw: Annotated[Path | None, typer.Option("--redraw", help="Draw the page again from these numbers.")] = None,
    endpoint: Endpoint = DEFAULT_ENDPOINT,
    as_json: AsJson = False,
) -> None:
    """Study how well the station lands: leave the point, land on it again and look, many times; Cg, Cgk and plots.

    This moves the head over the point and away, at the height of looks; nothing is touched.
    """
    from daemon.tools.report.command import own_settings  # noqa: PLC0415  # brings matplotlib

    if (redraw is None) == (test_point is None):
        fail("name either a test point or --redraw FILE", advice="reprobe study TP7 --times 50", code=USAGE)
    with own_settings():
        from daemon.tools.report.study import Study, capability, write_study  # noqa: PLC0415  # brings matplotlib

        _refuse_unwritable(output, Study)
        trouble: Trouble | None = None
        try:
            if redraw is not None:
                made = Study.model_validate_json(read_small(redraw))
            else:
                landed, trouble = _landings(endpoint, str(test_point), times, tolerance_um)
                made = Study(**landed)
        except ValidationError as exc:
            fail(f"{redraw} has no numbers of a study: {exc.errors()[0]['msg']}", code=USAGE)
        write_study(made, output)
        both = (("x", made.dx_um), ("y", made.dy_um))
        found = {axis: capability(values, made.tolerance_um) for axis, values in both}
    if as_json:
        said = {axis: vars(one) | {"least_tolerance_um": one.least_tolerance_um} for axis, one in found.items()}
        say_json({"page": str(output), "landings": len(made.dx_um), **said})
    else:
        _tell(found, output)
    if trouble is not None:
        done, (message, advice) = len(made.dx_um), _in_words(trouble)
        fail(f"only {done} of {times} landings are in it; the next one: {message}", advice=advice)


def _refuse_unwritable(page: Path, study_of: type[BaseModel]) -> None:
    """End before the first landing where page or numbers could not be written, or would replace what is no study."""
    if not page.name:
        fail("-o names no file", advice="name the page: -o study.html", code=USAGE)
    numbers = page.with_suffix(".json")
    if page == numbers:
        fail(f"{page} is where the numbers go", advice=f"name the page: -o {page.with_suffix('.html')}", code=USAGE)
    for file in (page, numbers):
        try:
            _prove_writable(file)
        except OSError as exc:
            fail(f"{file} cannot be written: {exc.strerror}", advice="name another page with -o", code=USAGE)
    try:
        if numbers.exists():
            study_of.model_validate_json(read_small(numbers))
    except (OSError, ValidationError):
        advice = "name another page with -o, or move that file away"
        fail(f"{numbers} is there and holds no study: the numbers would replace it", advice=advice, code=USAGE)


def _prove_writable(file: Path) -> None:
    """Raise OSError where a file could not be written; leave nothing behind, no folder either."""
    if file.is_dir():
        raise IsADirectoryError(errno.EISDIR, "it is a folder")
    missing = [folder for folder in file.parents if not folder.exists()]
    try:
        with written_beside(file, lambda _: None):
            pass
    finally:
        for folder in missing:
            with suppress(OSError):
                folder.rmdir()


def _tell(found: dict[str, Capability], output: Path) -> None:
    for axis, one in found.items():
        out.print(
            f"{axis.upper()}: bias {one.mean_um:+.1f} um, s {one.sd_um:.1f} um, Cg {one.cg:.2f}, Cgk {one.cgk:.2f}; "
            f"good enough for tolerances from {math.ceil(one.least_tolerance_um)} um on",
            highlight=False,
        )
    out.print(f"written to {output}", highlight=False, markup=False, soft_wrap=True)


def _landings(endpoint: str, test_point: str, times: int, tolerance_um: float) -> tuple[dict[str, Any], Trouble | None]:
    """Land again and again; return what the looks measured, and what ended it early.

    What is enough for a study is not thrown away for a landing that fails, or for Ctrl-C; less than that is no study.
    """
    dx_um: list[float] = []
    dy_um: list[float] = []
    trouble: Trouble | None = None
    with answered(), taken_as_ctrl_c(), Client(endpoint) as client:
        described = client.request("describe")
        points = {one["name"]: one for one in described["board"]["test_points"]}
        if test_point not in points:
            fail(f"the board has no test point {test_point}", advice="`reprobe describe` lists them", code=USAGE)
        away_um = [points[test_point]["x_um"] + AWAY_UM, points[test_point]["y_um"]]
        for number in range(1, times + 1):
            try:
                err.print(f"landing {number} of {times}", highlight=False)
                looked = _land(client, endpoint, test_point, away_um)
            except (Refused, NoAnswer, KeyboardInterrupt) as exc:
                trouble = exc
                if len(dx_um) >= LEAST_LANDINGS:
                    break
                message, advice = _in_words(exc)
                fail(f"landing {number}: {message}", advice=advice)
            dx_um.append(-float(looked["dx_um"]))
            dy_um.append(-float(looked["dy_um"]))
    said = {"station": described["station"], "test_point": test_point, "made_at": utc_now()}
    return {**said, "tolerance_um": tolerance_um, "dx_um": dx_um, "dy_um": dy_um}, trouble


def _land(client: Client, endpoint: str, test_point: str, away_um: list[float]) -> dict[str, Any]:
    """Leave the point and land on it again; return what the look said. Raises `Refused`, also for what failed.

    Ctrl-C cancels the job, so that the head stops.
    """
    looked: dict[str, Any] = {}
    there = {"test_point": test_point}
    for op, fields in (("place", {"board_um": away_um}), ("place", there), ("correct", there), ("look", there)):
        job_id = f"study-{uuid.uuid4().hex[:12]}"
        try:
            result = client.job(op, job_id=job_id, **fields)
        except KeyboardInterrupt:
            _cancel(endpoint, job_id)
            raise
        if result.error is not None:
            raise Refused(result.error.model_dump())
        looked = result.detail
    return looked


def _cancel(endpoint: str, job_id: str) -> None:
    """Cancel a job by a connection of its own: the other one waits for the job's answer."""
    try:
        with Client(endpoint) as another:
            another.request("cancel", id=job_id)
    except Refused:
        return  # it has ended
    except NoAnswer:
        err.print("[red]the daemon does not answer; the job goes on[/]")


def _in_words(trouble: Trouble) -> tuple[str, str]:
    """Return what happened, and what to do."""
    if isinstance(trouble, KeyboardInterrupt):
        return "it was interrupted", f"let it go on to its end, or ask for fewer --times ({LEAST_LANDINGS} at least)"
    if isinstance(trouble, Refused):
        return str(trouble.error["message"]), str(trouble.error["advice"])
    return str(trouble), "see that the daemon runs: `reprobe status`"


def page(
    what: Annotated[str, typer.Argument(help="map, rotation, surface, backlash, alignment, or a record's file.")],
    config: ConfigFile,
    output: Annotated[Path, typer.Option("--output", "-o", help="The page to write.")],
    previous: Annotated[Path | None, typer.Option(help="Record to compare with; the one before by default.")] = None,
) -> None:
    """Draw the page of a calibration again, the present one's or any record's of the history."""
    folder = load(config).station.data_dir / "calibration"
    record = folder / f"{what}.json"
    kept = sorted((folder / "history").glob(f"{what}-*.json"))
    before = previous or (kept[-1] if record.exists() and kept else None)
    if not record.exists():
        record = Path(what)
    if not record.is_file():
        there = ", ".join(sorted(one.stem for one in folder.glob("*.json") if "." not in one.stem)) or "none"
        fail(
            f"there is no calibration {what!r} in {folder}",
            advice=f"there are: {there}; older ones lie in its history/; `reprobe calibrate` makes them",
            code=USAGE,
        )
    arguments = [str(record), "-o", str(output), *(["--previous", str(before)] if before is not None else [])]
    code, words = asyncio.run(draw("daemon.tools.report", arguments, PAGE_WITHIN_S))
    if code:
        fail(words or f"the page was not drawn (status {code})", code=USAGE if code == USAGE else FAILED)
    out.print(f"written to {output}", highlight=False, markup=False, soft_wrap=True)


def certificate(
    config: ConfigFile,
    output: Annotated[Path, typer.Option("--output", "-o", help="The page to write.")] = Path("certificate.html"),
) -> None:
    """Write the calibration certificate: what, when, with which reference, error budget, valid until. No daemon."""
    from daemon.tools.report.certificate import write_certificate  # noqa: PLC0415  # brings matplotlib

    loaded = load(config)
    calibrations = Calibrations(loaded.station.data_dir / "calibration", loaded.station.name)
    calibrations.load()
    try:
        calibrations.fit_to(conditions_of(loaded, Board.load(loaded.board.file)))
    except ValueError as exc:
        fail(str(exc), code=USAGE)
    write_certificate(loaded, calibrations.in_force, output)
    out.print(f"written to {output}", highlight=False, markup=False, soft_wrap=True)
