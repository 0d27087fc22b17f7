"""HTML page of one job with its images inside, to be sent to somebody who was not there."""

from __future__ import annotations

import base64
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from daemon.cli.formatting import in_words
from daemon.platform.atomic_file import replace_whole
from daemon.platform.clock import WAITS
from daemon.storage.journal_reader import JobRow, Step


def pictures_of(row: JobRow) -> list[Path]:
    """Return the job's pictures that are still there, in the order in which they were taken."""
    folder = row.result.get("pictures") if row.result else None
    if not folder:
        return []
    found = [p for p in Path(folder).glob("*.jpg") if p.is_file() and not p.is_symlink()]
    return sorted(found, key=lambda p: (not p.name.startswith("before"), p.name))


def write_job_page(row: JobRow, steps: list[Step], page: Path) -> None:
    """Write the page; what is put into it is escaped, nothing is fetched."""
    loader = FileSystemLoader(Path(__file__).parent)
    environment = Environment(loader=loader, autoescape=True, undefined=StrictUndefined)
    environment.filters["in_words"] = in_words
    pictures = [(p.stem, base64.b64encode(p.read_bytes()).decode()) for p in pictures_of(row)]
    template = environment.get_template("job_page.html.j2")
    text = template.render(job=row, steps=steps, pictures=pictures, waits=(*WAITS, "software", "total"))
    replace_whole(page, lambda path: path.write_text(text, encoding="utf-8"))
