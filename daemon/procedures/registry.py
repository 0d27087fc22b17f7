"""Operation -> procedure: what each kind of job does."""

from __future__ import annotations

from collections.abc import Mapping

from daemon.jobs.context import Procedure
from daemon.procedures.align import align
from daemon.procedures.basic import home, look, place
from daemon.procedures.calibrate.dispatch import calibrate
from daemon.procedures.correct import correct

PROCEDURES: Mapping[str, Procedure] = {
    "correct": correct,
    "place": place,
    "look": look,
    "align": align,
    "calibrate": calibrate,
    "home": home,
}
