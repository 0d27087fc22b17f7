"""Plan file as a command reads it: its text, how it is written, and what it is called where it does not say so."""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path
from typing import Any

from daemon.cli.output import USAGE, fail
from daemon.client import Client, Refused
from daemon.config.plan_rows import PlanForm
from daemon.platform.plain_file import as_text, read_small

FORMS: dict[str, PlanForm] = {".toml": "toml", ".csv": "csv", ".tsv": "csv", ".txt": "csv"}


class PlanRefused(Exception):
    """The station found mistakes in a plan, each with `line` and `what`."""

    def __init__(self, mistakes: list[dict[str, Any]]) -> None:
        super().__init__(f"{len(mistakes)} mistakes")
        self.mistakes = mistakes


def send_plan(client: Client, action: str, text: str, form: PlanForm, name: str) -> dict[str, Any]:
    """Have a plan checked or stored; raise `PlanRefused` with its mistakes, or what the client raises."""
    try:
        return client.request("plan", action=action, text=text, form=form, name=name)
    except Refused as exc:
        if mistakes := exc.error["detail"].get("mistakes"):
            raise PlanRefused(mistakes) from exc
        raise


def is_plan_file(text: str) -> bool:
    """Whether what a person wrote is a file rather than the name of a stored plan."""
    return Path(text).suffix.lower() in FORMS or Path(text).is_file()


def plan_text(file: Path) -> tuple[str, PlanForm, str]:
    """Return text, form and name of a plan's file; end with an error for one that cannot be read."""
    form = FORMS.get(file.suffix.lower())
    if form is None:
        fail(f"{file} is no plan: its name ends neither in .toml nor in .csv", code=USAGE)
    try:
        text = as_text(read_small(file))
    except ValueError as exc:
        fail(f"{file} is no text: {exc}", advice="save it as UTF-8, then send it again", code=USAGE)
    except OSError as exc:
        fail(f"{file} cannot be read: {exc.strerror}", advice="see that the path is right", code=USAGE)
    name = re.sub(r"[^A-Za-z0-9_.+-]", "-", file.stem).lstrip("_.+-")[:64] or "plan"
    return (text if form == "toml" else _with_tabs(text)), form, name


def _with_tabs(text: str) -> str:
    """Return CSV with tabs for its commas, line by line: no request may have as many commas as a long file."""
    lines = text.splitlines()
    rows = []
    for line in lines:
        if line.lstrip().startswith("#") or line.count(",") < max(line.count(";"), line.count("\t")):
            rows.append(line)
            continue
        cells = next(csv.reader(io.StringIO(line)), [])
        written = io.StringIO()
        csv.writer(written, delimiter="\t", lineterminator="").writerow(cells)
        rows.append(written.getvalue())
    return "\n".join(rows) + "\n"
