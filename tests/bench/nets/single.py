"""Judgement of a single point's test, by the truth alone: what is wrong with it, and why the first touch read open."""

from __future__ import annotations

from daemon.tools.demo import true_verdict
from daemon.tools.demo.truth_log import Stroke
from tests.bench.nets.records import Station, Visit

FASTEST_UM_S = 2500.0
FORCE_SHARE = 0.10
DRAG_UM = 2.0
UP_UM = 100.0
TOUCHES, PRESSES = 3, 8
"""Most of one visit of a pad."""
STUBBORN = ("stubborn", "flux")
FAULTED = "fault:"
"""Begins the verdict of a test into which a fault came; what the daemon said of it is the reason then."""


def wrong_verdict(tested: Visit) -> str | None:
    """Return what is wrong with the verdict (S9), or None."""
    said = tested.reason if tested.verdict.startswith(FAULTED) else tested.verdict
    return true_verdict.wrong_verdict(said, tested.net, tested.happened.on_board, sound=tested.sound)


def violations(tested: Visit, station: Station) -> list[str]:
    """Name every safety property (design: touch, section 12) that was broken in a point's test."""
    happened, strokes = tested.happened, tested.happened.strokes
    fastest = max((stroke.speed_um_s for stroke in strokes), default=0.0)
    hardest = max((stroke.force_n for stroke in strokes), default=0.0)
    pads = _by_pad(tested)
    touches = sum(stroke.first for stroke in happened.on_board)
    broken = {
        "S1 sideways while pressed": happened.scratches or happened.dragged_um > DRAG_UM,
        "S2 force": happened.dents or hardest > station.dent_n,
        "S2 floor": happened.lowest_z_um is not None and happened.lowest_z_um < station.floor_z_um - 1.0,
        "S2 speed": fastest > FASTEST_UM_S,
        "S3 pressed after the end": tested.pressed_after_um > 0.0,
        "S6 not up after the end": tested.height_after_um < UP_UM,
        "S7 budget": any(sum(one.first for one in pad) > TOUCHES or len(pad) > PRESSES for pad in pads),
        "S8 pressed again unseen": any(not stroke.seen for pad in pads for stroke in pad[1:]),
        "S9 wrong verdict": wrong_verdict(tested),
        "S10 touched after its verdict": tested.had_verdict and touches,
        "S11 lowered with a closed sense": tested.verdict == "fault:sense_stuck" and strokes,
    }
    return [name for name, is_so in broken.items() if is_so]


def _by_pad(tested: Visit) -> list[list[Stroke]]:
    """Return the strokes on the board in their order; where a kill cut a run short, those of each pad by themselves.

    Between the last record that was heard and the kill another point may have been tested.
    """
    if not tested.killed:
        return [tested.happened.on_board]
    pads: dict[str | None, list[Stroke]] = {}
    for stroke in tested.happened.on_board:
        pads.setdefault(stroke.pad, []).append(stroke)
    return list(pads.values())


def first_open(tested: Visit) -> str | None:
    """Return why a sound net could not be measured at the first stroke: off its pad, film or debris; None: it could."""
    return true_verdict.first_open(tested.net, tested.happened.on_board, sound=tested.sound)


def curable(tested: Visit) -> bool:
    """Tell whether what made the first touch read open can be cured: no film that hardly breaks lay below a stroke."""
    return first_open(tested) is not None and all(stroke.film not in STUBBORN for stroke in tested.happened.on_board)


def strokes_off(tested: Visit) -> int:
    """Count the strokes on the board that were not on the pad's own net."""
    return sum(not true_verdict.on_net(tested.net, stroke) for stroke in tested.happened.on_board)


def force_is_off(tested: Visit) -> bool:
    """Tell whether the last press was farther from the force that was said than may be."""
    last = next(reversed(tested.happened.on_board), None)
    if last is None or not tested.said_force_n:
        return False
    return abs(last.force_n / tested.said_force_n - 1.0) > FORCE_SHARE
