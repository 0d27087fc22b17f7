"""Command that draws one calibration's page and renews the index beside it.

Exit status 0: written. 1: a file could not be read or written. 2: the call or a record is wrong. With 1 and 2 one line
on stderr says why, and a page that was there before is as it was.
"""

from __future__ import annotations

import sys
from pathlib import Path

from daemon.tools.report.command import NOT_WRITTEN, OK, WRONG, Parser, own_settings, say


def main(arguments: list[str] | None = None) -> int:
    """Run the command; return its exit status."""
    parser = Parser(prog="python -m daemon.tools.report", description=__doc__)
    parser.add_argument("record", type=Path, help="the calibration's JSON record")
    parser.add_argument("--previous", type=Path, help="the record it replaced, for the drift")
    parser.add_argument("-o", "--output", type=Path, required=True, help="the page to write")
    given = parser.parse_args(arguments)
    with own_settings():
        return _draw(given.record, given.previous, given.output)


def _draw(record: Path, previous: Path | None, output: Path) -> int:
    # Only now: these bring matplotlib, which reads its settings when it is imported.
    from daemon.storage.calibration_records import read_record  # noqa: PLC0415
    from daemon.tools.report.index import INDEX, renew_index  # noqa: PLC0415
    from daemon.tools.report.pages import write_page  # noqa: PLC0415

    if output.name == INDEX:
        return say(f"{INDEX} is the index of the folder; name the page otherwise", WRONG)
    try:
        now, before = read_record(record), read_record(previous) if previous else None
        write_page(now, before, output)
        renew_index(output.parent)
    except ValueError as exc:
        return say(str(exc), WRONG)
    except OSError as exc:
        return say(str(exc), NOT_WRITTEN)
    return OK


if __name__ == "__main__":
    sys.exit(main())
