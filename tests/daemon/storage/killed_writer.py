"""A process that stores a calibration and is killed before one of its steps, again and again, one step later each time.

Called with a folder that holds `before/`, the calibrations to begin with, and `record.json` or `probe.npz`, what to
store. Leaves `after-N/` for each N, and prints the steps of the run that was left alone.
"""

from __future__ import annotations

import itertools
import json
import os
import shutil
import sys
from pathlib import Path

from daemon.storage.calibration_records import read_record
from daemon.storage.calibration_store import Calibrations
from tests.daemon.storage.disk_steps import Steps, killed
from vision import ProbeModel


def main(folder: Path, station: str) -> None:
    """Store and be killed until a run comes to its end."""
    for at in itertools.count(1):
        after = folder / f"after-{at}"
        shutil.copytree(folder / "before", after)
        child = os.fork()
        if child == 0:
            _store(folder, after, station, at)
        _, status = os.waitpid(child, 0)
        if not os.WIFSIGNALED(status):
            sys.exit(os.waitstatus_to_exitcode(status))


def _store(folder: Path, after: Path, station: str, at: int) -> None:
    """Store what is in the folder, unless killed before; never returns."""
    calibrations, steps = Calibrations(after, station), Steps(at, killed)
    calibrations.load()
    new = folder / "record.json"
    record = read_record(new) if new.exists() else None
    probe = None if record else ProbeModel.load(folder / "probe.npz")
    with steps.watched():
        if record is not None:
            calibrations.store(record)
        elif probe is not None:
            calibrations.store_probe(probe)
    sys.stdout.write(json.dumps(steps.taken))
    sys.stdout.flush()
    os._exit(0)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
