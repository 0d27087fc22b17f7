"""A daemon broken on purpose: it shows that the campaign's judge says what it is there to say.

    python -m tests.bench.faults.broken HOW run --config station.toml

`pressed`: no job raises the needle at its end. `sideways`: nor does a move raise it before it goes aside.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from daemon.cli import main
from daemon.jobs import safe_ending
from daemon.station.needle import Needle
from daemon.station.station import Station
from drivers.gantry import driver
from drivers.gantry.path import Leg, plan


async def _not_raised(*_anything: Any) -> list[Any]:
    return []


async def _not_looked(*_anything: Any) -> None:
    return


def break_pressed() -> None:
    """Leave the needle where a job's end finds it, and say nothing."""
    safe_ending._raise = _not_raised  # noqa: SLF001


def break_sideways() -> None:
    """Go straight to a place, from wherever the needle is."""
    break_pressed()

    def dragging(now: Any, target: Any, *rest: Any) -> list[Leg]:
        legs = plan(now, target, *rest)
        return legs[1:] if len(legs) > 1 and set(legs[0].to) == {"z"} and legs[0].to["z"] > now.z_um else legs

    driver.plan = dragging
    Needle.refuse_sideways = lambda *_anything: None  # type: ignore[method-assign]
    Needle.is_up = property(lambda _needle: True)  # type: ignore[assignment, method-assign]
    Station.may_go = _not_looked  # type: ignore[method-assign]


WAYS: dict[str, Callable[[], None]] = {"pressed": break_pressed, "sideways": break_sideways}

if __name__ == "__main__":
    WAYS[sys.argv.pop(1)]()
    main()
