"""Catalogue of watches, as data: what each follows, when a change matters, what restarts it, what to do.

A new watch is a line here and a stream of that name (`signals`, `device_signals`, `image_metrics`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Final, Literal

from daemon.config.watch_names import AXES, SECTOR_DEG, sector_name
from daemon.maintenance.proportion_test import ShareSettings
from daemon.maintenance.xmr_chart import ChartSettings

Base = Literal["probe", "map", "rotation", "surface", "alignment"]
BOARD: Final = 100
"""Touches that are likely to be of one board, and so share where it lies and how high."""
LEARNED: Final = ("probe", "map", "rotation", "surface")


@dataclass(frozen=True)
class Spec:
    """One watch. `name` is also its stream's and its alert's; `settings` of None is a limit known beforehand.

    bases: calibrations that restart it. what: completes "... is not what it was".
    """

    name: str
    group: str
    what: str
    unit: str
    settings: ChartSettings | ShareSettings | None
    advice: str
    bases: tuple[Base, ...] = ()
    digits: int = 1


_ALIGN = "align the board again (`reprobe align`); if it stays, look at the nest"
_HEAD = (
    "calibrate the rotation again (`reprobe calibrate rotation`); see that the head's clamp and the needle sit firmly"
)
_SCATTER = "measure the play (`reprobe calibrate backlash`); look after spindles, couplings and guides of X and Y"
_NEEDLE = "look at the needle: straighten, clean or replace it, then `reprobe calibrate tip`"
_LAMP = "clean ring and cover; replace the ring before pictures become unusable"

_MISS: Final = ChartSettings(side="high", floor=15.0, spread=BOARD)
_MEAN: Final = ChartSettings(floor=15.0, spread=BOARD)
"""Less than a landing's tolerance is nobody's trouble."""
_PLACEMENT: Final = (
    Spec("placement_error", "placement", "how far the tip lands from the pad before it is corrected", "um",
         _MISS, "see which of the other placement alerts stands; if none, calibrate "
         "rotation and map again", LEARNED),
    Spec("placement_x", "placement", "the mean miss along X (board pose)", "um", _MEAN, _ALIGN,
         (*LEARNED, "alignment")),
    Spec("placement_y", "placement", "the mean miss along Y (board pose)", "um", _MEAN, _ALIGN,
         (*LEARNED, "alignment")),
    Spec("head_along", "placement", "the mean miss in the head's sense of turning", "um", _MEAN,
         _HEAD, LEARNED),
    Spec("head_across", "placement", "the mean miss away from the head's axis", "um", _MEAN,
         _HEAD, LEARNED),
    Spec("placement_scatter", "placement", "the scatter from one landing to the next", "um",
         ChartSettings(side="high", floor=8.0, spread=BOARD), _SCATTER, LEARNED),
)  # fmt: skip
_SECTOR: Final = Spec(
    "placement_at", "placement", "how far the tip lands from the pad at head angles", "um",
    ChartSettings(baseline=40, batch=4, side="high", floor=20.0, spread=BOARD), _HEAD, LEARNED,
)  # fmt: skip
_CORRECTIONS: Final = Spec(
    "correction_share", "corrections", "the share of touches that need a correction", "of touches",
    ShareSettings(ceiling=0.3, clump=4.0), "see which placement alert stands; if none, clean pads and needle",
    ("probe",), 4,
)  # fmt: skip
_FEW: Final = ShareSettings(block=2, windows=(1, 3, 5, 10, 25, 50), least=60, most=2000, times=2.0, ceiling=0.05)
"""For what hardly ever happens: six in six are enough, whatever was usual."""
_FAILURES: Final = (
    Spec("tip_refused", "tip", "the share of corrections in which the tip was not found or not as taught",
         "of corrections", _FEW, "look at a saved picture: straighten, clean or replace the needle, then `reprobe "
         "calibrate tip`", ("probe",), 3),
    Spec("pictures_unusable", "light", "the share of corrections whose picture was too dark, too bright or blurred",
         "of corrections", _FEW, "check lamps, exposure and focus", (), 3),
    Spec("pads_not_found", "corrections", "the share of corrections that found no pad or could not decide on one",
         "of corrections", replace(_FEW, ceiling=0.3), "check the board's alignment and the red ring; clean the boards",
         LEARNED, 3),
)  # fmt: skip
_TIP: Final = (
    Spec("tip_length", "tip", "where the needle ends, from its marking", "px", ChartSettings(floor=5.0),
         _NEEDLE, ("probe",), 2),
    Spec("tip_width", "tip", "the needle's width", "px", ChartSettings(floor=1.0), _NEEDLE, ("probe",), 2),
    Spec("tip_contrast", "tip", "how dark the needle's marking is", "", ChartSettings(side="low", floor_share=0.12),
         "renew the black marking, then `reprobe calibrate tip`", ("probe",), 3),
    Spec("tip_bend", "tip", "how far taper and cylinder of the needle disagree at the end", "px",
         ChartSettings(floor=1.2), _NEEDLE, ("probe",), 2),
    Spec("tip_x", "tip", "where the tip is in the picture, to the right", "px", ChartSettings(floor=1.5),
         f"{_NEEDLE}; see that the camera sits firmly", ("probe",), 2),
    Spec("tip_y", "tip", "where the tip is in the picture, downwards", "px", ChartSettings(floor=1.5),
         f"{_NEEDLE}; see that the camera sits firmly", ("probe",), 2),
)  # fmt: skip
_LIGHT: Final = (
    Spec("light_white", "light", "the white ring's brightness on the needle", "levels",
         ChartSettings(floor_share=0.04), _LAMP, ("probe",)),
    Spec("light_red", "light", "the red ring's brightness on the needle", "levels",
         ChartSettings(floor_share=0.04), _LAMP, ("probe",)),
)  # fmt: skip
_CAMERA: Final = (
    Spec("focus", "camera", "the sharpness of the marking's rim", "1/px", ChartSettings(side="low", floor_share=0.08),
         "clean the lens and lock its focus ring, then teach the tip and calibrate the map again", ("probe",), 3),
    Spec("noise", "camera", "the noise of white pictures", "levels", ChartSettings(side="high", floor_share=0.25),
         "see that exposure and gain are as configured; a camera that grows hot is noisy", (), 2),
    Spec("frames_missed", "camera", "the share of pictures that were dropped before they were fetched", "of pictures",
         ShareSettings(block=2000, windows=(1, 4, 16, 64), least=40_000, most=200_000, times=3.0, absolute=0.05,
                       clump=20.0),
         "see what else keeps the computer busy", (), 3),
    Spec("frames", "camera", "the share of pictures that were torn, frozen or never came", "of pictures",
         ShareSettings(block=500, windows=(1, 4, 16, 64), least=10_000, most=200_000, times=2.0, absolute=5e-3,
                       ceiling=0.05, clump=3.0),
         "check the camera's cable and its place on the USB tree; replace the cable first", (), 5),
)  # fmt: skip
_LINE = ShareSettings(
    block=100,
    windows=(1, 5, 20, 80, 320),
    least=10_000,
    most=200_000,
    times=2.0,
    absolute=3e-4,
    ceiling=0.002,
    clump=3.0,
)
_BUS: Final = (
    Spec("bus_timeouts", "bus", "the share of requests without an answer", "of requests", _LINE,
         "check connectors and supply of the slaves on the line; replace the cable first", (), 5),
    Spec("bus_garbled", "bus", "the share of requests with a garbled answer (CRC)", "of requests", _LINE,
         "check the shield and the termination of the line, and what switches beside it; replace the cable first",
         (), 5),
)  # fmt: skip
_STOPS: Final = (
    Spec("stop_scatter", "axes", "how far off the tip is after the first corrective move", "um",
         ChartSettings(side="high", floor=4.0), _SCATTER, ("probe", "map")),
    Spec("more_moves", "axes", "the share of corrections that had to move again", "of corrections",
         ShareSettings(block=10, windows=(3, 5, 10, 20, 40), least=100, most=500, times=1.3), _SCATTER,
         ("probe", "map"), 3),
)  # fmt: skip
_AXIS: Final = (
    Spec("arrival", "axes", "how far from its target the axis says it stopped", "units",
         ChartSettings(side="high", floor=0.6), "see that the axis moves freely; look after its motor current", (), 3),
    Spec("following", "axes", "the drive's following error", "units", ChartSettings(side="high", floor=0.6),
         "see that the axis moves freely; look after its motor current", (), 3),
    Spec("drive", "axes", "a warning or an error word of the drive", "",  None,
         "see the evidence for the drive's own words; let a hot drive cool, then look for what makes it work so hard",
         (), 0),
)  # fmt: skip
_LIMITS: Final = (
    Spec("calibration_age", "calibration", "the age of the map", "days", None,
         "calibrate the map again (`reprobe calibrate map`) before it expires"),
    Spec("head_total_error", "calibration", "the total error of the head model in force (eq. 6.8, as rms)", "um", None,
         f"the head had moved since the calibration before: {_HEAD}"),
    Spec("head_closure", "calibration", "how far the first angle was from itself at the end of the rotation", "um",
         None, _SCATTER),
    Spec("backlash_x", "calibration", "the play of X", "um", None, _SCATTER),
    Spec("backlash_y", "calibration", "the play of Y", "um", None, _SCATTER),
    Spec("surface", "calibration", "how far the surface is from a plane", "um", None,
         "clean the nest and see that boards lie flat, then `reprobe calibrate surface`"),
    Spec("probe_life", "probe", "the touches made with this probe", "touches", None,
         "replace the probe, then `reprobe calibrate tip`", ("probe",), 0),
    Spec("pictures_not_kept", "daemon", "pictures cannot be kept", "", None, "free disk space", (), 0),
    Spec("journal_moved_aside", "daemon", "the journal could not be read and was begun anew", "", None,
         "keep the file named for whoever looks after the daemon; acknowledge this when it is safe", (), 0),
    Spec("journal_not_written", "daemon", "the journal cannot be written, and no job is taken", "", None,
         "free disk space; a journal that was deleted or is damaged needs `reset`", (), 0),
    Spec("needle_down", "daemon", "the needle is not known to be up, and may press on a board", "", None,
         "see that it may be raised, then `reprobe lift`; where the axes are not homed, `reprobe home`", (), 0),
    Spec("repeated_failures", "daemon", "jobs or points fail again and again in the same way", "", None,
         "do what is said of the last failure, then the same again: it is over when that goes well, or when you say"
         " so by `reprobe acknowledge repeated_failures --mended`", (), 0),
    Spec("not_served", "daemon", "events, live pictures or metrics are not served, for their address cannot be had", "",
         None, "free the address that is named: it is tried again every minute; or choose another, then restart the"
         " daemon", (), 0),
    Spec("clock_behind", "daemon", "the computer's clock is behind: ages and dates of results are wrong", "", None,
         "set the clock (`timedatectl set-time`, or a time server), then restart the daemon; a computer whose clock has"
         " no battery needs a network that tells the time", (), 0),
)  # fmt: skip
_POINTS = ShareSettings(block=25, windows=(2, 4, 8, 16, 32, 64), least=500, most=5000, times=1.5, absolute=0.02,
                       ceiling=0.3, clump=4.0)  # fmt: skip
"""Points of one board hang together: it lies askew, or its pads are oxidised."""
_RUNG = replace(_POINTS, least=1000, times=2.0, absolute=0.01, ceiling=0.2)
_CONTACT: Final = (
    Spec("first_touch_misses", "contact", "the share of points that do not pass at the first touch (1 - yield)",
         "of points", _POINTS, "see which rung recovers them: look, pump or reference pad; then mend that cause",
         ("probe",), 4),
    Spec("contact_not_made", "contact", "the share of points at which no contact could be proved", "of points", _RUNG,
         "clean or replace the needle; look at the kept pictures of these pads", ("probe",), 4),
    Spec("recovered_by_look", "contact", "the share of points whose first touch missed the pad", "of points", _RUNG,
         "see which placement alert stands; if none, calibrate rotation and map again", LEARNED, 4),
    Spec("recovered_by_pump", "contact", "the share of points that read well only after more presses (films)",
         "of points", _RUNG, "clean the boards; a blunt needle breaks no film: replace it", ("probe",), 4),
    Spec("recovered_by_reference", "contact", "the share of points that read well only after the needle was brushed",
         "of points", _RUNG, _NEEDLE, ("probe",), 4),
    Spec("recovered_by_site", "contact", "the share of points that read well only at a second place of the pad",
         "of points", _RUNG, "clean the boards: look for flux on the pads", ("probe",), 4),
    Spec("reference_ohms", "contact", "what the needle reads on the reference pad", "ohm",
         ChartSettings(side="high", floor=0.05), f"brush the needle and clean the reference pad; {_NEEDLE}",
         ("probe",), 3),
)  # fmt: skip
_SINGLE: Final = (*_PLACEMENT, _CORRECTIONS, *_FAILURES, *_TIP, *_LIGHT, *_CAMERA, *_STOPS, *_LIMITS, *_CONTACT)


def all_specs(buses: Iterable[str]) -> Iterator[Spec]:
    """Yield every watch of a station with these lines."""
    yield from _SINGLE
    for start in range(0, 360, SECTOR_DEG):
        what = f"{_SECTOR.what} {start}..{start + SECTOR_DEG} deg"
        yield replace(_SECTOR, name=sector_name(start), what=what)
    for bus in sorted(buses):
        for spec in _BUS:
            yield replace(spec, name=f"{spec.name}_{bus}", what=f"{spec.what} on line {bus!r}")
    for axis in AXES:
        for spec in _AXIS:
            unit = "deg" if axis == "theta" else "um"
            settings = spec.settings
            if isinstance(settings, ChartSettings) and axis == "theta":
                settings = replace(settings, floor=0.012)
            named = replace(spec, name=f"{spec.name}_{axis}", what=f"{axis}: {spec.what}", settings=settings)
            yield replace(named, unit=unit if spec.unit == "units" else spec.unit)


def chosen(buses: Iterable[str], *, off: Iterable[str], baseline: int, batch: int) -> dict[str, Spec]:
    """Return name -> watch without those switched off (by name or group), charts with the station's own windows.

    Sectors keep shorter ones: each gets only a part of the landings.
    """
    unwanted = set(off)
    specs = {}
    for spec in all_specs(buses):
        if spec.name in unwanted or spec.group in unwanted:
            continue
        if isinstance(spec.settings, ChartSettings):
            size = (
                (baseline, batch) if spec.settings.baseline == ChartSettings().baseline else _shorter(baseline, batch)
            )
            spec = replace(spec, settings=replace(spec.settings, baseline=size[0], batch=size[1]))
        specs[spec.name] = spec
    return specs


def _shorter(baseline: int, batch: int) -> tuple[int, int]:
    """Return the windows of a sector: two thirds of the baseline, a batch one shorter."""
    size = max(1, batch - 1)
    return max(2 * size, baseline * 2 // 3), size
