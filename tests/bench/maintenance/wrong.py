"""What can go wrong with a model station, each as a course over the touches since it began."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

SHARE = 0.05
FAILURES = (("tip_not_found", 0.003), ("ambiguous", 0.006), ("frame_unusable", 0.0005))
"""How corrections fail on a healthy station, and how often."""


@dataclass(frozen=True)
class Wrong:
    """What is wrong with the station at a moment; a healthy one has none of it."""

    bend_px: float = 0.0
    worn_px: float = 0.0
    marking: float = 1.0
    white: float = 1.0
    red: float = 1.0
    focus: float = 1.0
    noise: float = 1.0
    knock_px: float = 0.0
    """By which the camera has been knocked to the side."""
    play_um: float = 0.0
    """By which a stop is off at most, to either side: the play that the approach does not take up."""
    slip_um: float = 0.0
    """By which the head has turned on its shaft, at the tip."""
    reach_um: float = 0.0
    """By which the tip stands further out from the head's axis."""
    sector_um: float = 0.0
    """The same at angles 225..270 only: a cable that pulls there."""
    board_um: float = 0.0
    """By which the nest has moved along X."""
    following_um: float = 0.0
    drive_warns: bool = False
    timeouts: float = 1e-6
    garbled: float = 1e-6
    torn: float = 1e-5
    missed: float = 1e-3
    map_days: float = 1.0
    probe_touches: float = 100.0
    share: float = SHARE
    failures: tuple[tuple[str, float], ...] = FAILURES
    films: float = 0.04
    """Share of points whose film one press does not break."""
    reference_ohm: float = 0.2
    """What the needle reads on the reference pad."""


Course = Callable[[int], Wrong]


@dataclass(frozen=True)
class Planted:
    """A degradation by the touches since it began, and the alerts that are right about it."""

    what: str
    course: Course
    right: frozenset[str]


def _falls(touches: int, per_touch: float) -> float:
    return max(0.0, 1.0 - per_touch * touches)


def _fails(name: str, chance: float) -> Wrong:
    return Wrong(failures=tuple((n, chance if n == name else usual) for n, usual in FAILURES))


def _plant(what: str, course: Course, *right: str) -> Planted:
    return Planted(what, course, frozenset(right))


PLANTED: Mapping[str, Planted] = {
    "bent tip": _plant("bent by 2 px at once", lambda _t: Wrong(bend_px=2.0), "tip_bend", "tip_x"),
    "worn tip": _plant("its end goes by 1 px in 200 touches", lambda t: Wrong(worn_px=t / 200.0),
                       "tip_length", "tip_width"),
    "marking": _plant("pales by 1 % in 200 touches", lambda t: Wrong(marking=_falls(t, 5e-5)), "tip_contrast"),
    "white lamp": _plant("fades by 1 % in 1000 touches", lambda t: Wrong(white=_falls(t, 1e-5)), "light_white"),
    "red lamp": _plant("10 % darker at once", lambda _t: Wrong(red=0.9), "light_red"),
    "focus": _plant("2 % in 1000 touches", lambda t: Wrong(focus=_falls(t, 2e-5)), "focus"),
    "noise": _plant("grows by half in 2000 touches", lambda t: Wrong(noise=1.0 + t / 4000.0), "noise"),
    "camera": _plant("knocked by 3 px", lambda _t: Wrong(knock_px=3.0), "tip_x"),
    "missed": _plant("a tenth of the pictures is dropped", lambda _t: Wrong(missed=0.1), "frames_missed"),
    "torn": _plant("2 % of the pictures are torn", lambda _t: Wrong(torn=0.02), "frames"),
    "play": _plant("the stops' share of a growing play, 3 um in 1000 touches", lambda t: Wrong(play_um=3e-3 * t),
                   "stop_scatter", "placement_scatter", "placement_error", "more_moves"),
    "slip": _plant("the head slips by 0.5 um in 100 touches", lambda t: Wrong(slip_um=5e-3 * t),
                   "head_along", "placement_error", "placement_scatter"),
    "reach": _plant("the tip stands out by 30 um more", lambda _t: Wrong(reach_um=30.0),
                    "head_across", "placement_error", "placement_scatter"),
    "sector": _plant("100 um off at 225..270 deg", lambda _t: Wrong(sector_um=100.0),
                     "placement_at_225", "head_across", "placement_error", "placement_scatter"),
    "nest": _plant("boards lie 60 um off along X", lambda _t: Wrong(board_um=60.0),
                   "placement_x", "placement_error"),
    "axis": _plant("x stops and follows 2 um off", lambda _t: Wrong(following_um=2.0), "following_x", "arrival_x"),
    "drive": _plant("z warns", lambda _t: Wrong(drive_warns=True), "drive_z"),
    "time-outs": _plant("double in 500 touches, from 1 in 1,000,000",
                        lambda t: Wrong(timeouts=min(0.5, 1e-6 * 2.0 ** (t / 500.0))), "bus_timeouts_main"),
    "crc": _plant("1 answer in 500 is garbled", lambda _t: Wrong(garbled=2e-3), "bus_garbled_main"),
    "map": _plant("grows older by a day in 1000 touches, from 10", lambda t: Wrong(map_days=10.0 + t / 1000.0),
                  "calibration_age"),
    "probe": _plant("was changed 99,000 touches before", lambda t: Wrong(probe_touches=99_000.0 + t), "probe_life"),
    "corrections": _plant("5 -> 12 % at once", lambda _t: Wrong(share=0.12), "correction_share"),
    "blind": _plant("half of the corrections find no tip", lambda _t: _fails("tip_not_found", 0.5), "tip_refused"),
    "dark": _plant("half of the pictures are unusable", lambda _t: _fails("frame_unusable", 0.5),
                   "pictures_unusable"),
    "dirt": _plant("a third of the corrections cannot decide on a pad", lambda _t: _fails("ambiguous", 0.33),
                   "pads_not_found"),
    "blunt needle": _plant("films that one press does not break, 4 -> 15 % at once", lambda _t: Wrong(films=0.15),
                           "first_touch_misses", "recovered_by_pump"),
    "dirty needle": _plant("reads 0.1 ohm more in 1000 touches", lambda t: Wrong(reference_ohm=0.2 + 1e-4 * t),
                           "reference_ohms"),
}  # fmt: skip
