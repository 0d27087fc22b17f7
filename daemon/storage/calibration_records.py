"""Calibration records: one JSON file each, with date, station, all that was measured and what followed from it.

Every kind keeps the raw measurements beside the fitted numbers, and the limits that judged them, so that a page can be
drawn from the file alone and the fit can be repeated years later. Lengths um, angles degrees, px as the names say.

The files are a format: fields may be added with a default, for older files lack them; none may change its meaning. The
defaults of the limits are what judged the records that do not say.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from daemon.platform.plain_file import read_small
from daemon.storage.calibration_conditions import Conditions

FORMAT: Literal["reprobe-calibration-2"] = "reprobe-calibration-2"
Pair = tuple[float, float]


class _Part(BaseModel):
    """Base of everything in a record: frozen, nothing unknown, no NaN."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class SeenTarget(_Part):
    """One sighting of the resting mark: its pixel as if the tip were at the map's tip, and where the head stood."""

    theta_deg: float
    target_px: Pair
    x_um: float
    y_um: float


class Made(_Part):
    """What every record says of itself."""

    format: Literal["reprobe-calibration-2"] = FORMAT
    station: str
    made_at: str
    job: str
    """Id of the job that made it."""
    probe: str
    """Fingerprint of the taught probe it was made with."""
    seconds: float
    looks: int
    conditions: Conditions | None = None
    """What the station was set to; None in records of older versions."""


class MapLimits(_Part):
    """What a map had to keep to."""

    residual_um: float = 15.0
    """Largest rms that the fit may leave at its sightings."""
    left_share: float = 0.5
    """A map that leaves this share of an error, or more, was refused."""


class MapRecord(Made):
    """The map from image to robot."""

    what: Literal["map"] = "map"
    mark: str
    theta_deg: float
    tip_px: Pair
    sightings: tuple[SeenTarget, ...]
    pose_map: dict[str, Any]
    """`PoseMap.to_json`, decoded."""
    limits: MapLimits = MapLimits()


class Stop(_Part):
    """One head angle: where the head stands when the tip is on the control point, and what it took."""

    theta_deg: float
    x_um: float
    y_um: float
    off_um: float
    """How far off the tip was when it first came there."""
    looks: int


class TrialLanding(_Part):
    """One jump to the control point by calculation alone: where the tip was from it, robot frame."""

    theta_deg: float
    dx_um: float
    dy_um: float


class Circle(_Part):
    """The least-squares circle of the stops."""

    centre_um: Pair
    radius_um: float
    rms_um: float


class RotationLimits(_Part):
    """What a rotation had to keep to."""

    holdout_um: float = 60.0
    """Largest rms by which angles left out of the fit may be predicted."""
    landing_um: float = 200.0
    """Farthest landing by the new model."""
    closure_um: float = 40.0
    """Farthest that the first angle may be from its first stop at the end."""


class RotationRecord(Made):
    """The head model, with the stops it was fitted to."""

    what: Literal["rotation"] = "rotation"
    control_um: Pair
    """Where the configuration has the control point."""
    card_height_um: float
    """Its surface above the nominal touching plane."""
    stops: tuple[Stop, ...]
    used: tuple[bool, ...]
    residuals_um: tuple[Pair, ...]
    """Measured minus model at each stop."""
    head: dict[str, Any]
    """`vision.head.head_to_dict`."""
    kind: str
    order: int | None
    rms_um: float
    holdout_rms_um: float
    holdout_max_um: float
    circle: Circle
    total_error_um: float
    """Eq. 6.8, of the head in force until then."""
    closure_um: float
    """How far from its first stop the first angle was at the end."""
    before: tuple[TrialLanding, ...]
    """Landings that the head model in force before this calibration gives, at the stops."""
    after: tuple[TrialLanding, ...]
    """Landings by the new model at angles that were not fitted, looked at afterwards."""
    sightings: tuple[SeenTarget, ...]
    limits: RotationLimits = RotationLimits()
    legs: int = 1
    """How many jobs measured it, each from where the one before was interrupted; looks and seconds are of all."""


class Touch(_Part):
    """The surface's height at one place, by how far the pin was pushed in."""

    x_um: float
    y_um: float
    height_um: float


class SurfaceRecord(Made):
    """The plane below the probe."""

    what: Literal["surface"] = "surface"
    touches: tuple[Touch, ...]
    residuals_um: tuple[float, ...]
    surface: dict[str, Any]
    """`vision.geometry.Surface.to_dict`."""
    flatness_um: float
    rms_um: float
    limit_um: float
    """By how much the touches may differ in height for the surface to count as planar."""
    planar: bool
    max_rms_um: float = 25.0
    """Largest rms that the plane may leave; beyond it there was no plane."""


class AxisBacklash(_Part):
    """One axis: where the tip was seen when it came from below and from above, along the axis."""

    from_below_um: tuple[float, ...]
    from_above_um: tuple[float, ...]
    backlash_um: float
    sigma_um: float


class BacklashRecord(Made):
    """The play of X and Y."""

    what: Literal["backlash"] = "backlash"
    x: AxisBacklash
    y: AxisBacklash
    approach_um: float
    """Overshoot of the one-sided approach, which has to be larger than any play."""


class Aligned(_Part):
    """One fiducial: where CAD has it and where it was seen."""

    name: str
    board_um: Pair
    robot_um: Pair
    residual_um: Pair
    views: int


class AlignmentLimits(_Part):
    """What an alignment had to keep to."""

    residual_um: float = 60.0
    """Largest distance of one fiducial from where the fit puts it."""
    scale_error: float = 0.002
    """Largest difference of the scale from 1."""
    turn_deg: float = 3.0
    """Largest turn against the configuration."""


class SeatLook(_Part):
    """One look at a place of the seat: how much of it agreed with CAD, and what is most like it elsewhere."""

    name: str
    board_um: Pair
    theta_deg: float
    agreement: float
    log_odds: float
    turn_deg: float
    rival: float
    """How near another place of the board comes to being taken for it; from 1 on it would."""


class Seat(_Part):
    """How it was settled which board lies there, which side up, and how turned."""

    verified: bool
    """Whether two places or more were seen that are found once on the board."""
    places: int
    agreement: float
    """The least of all looks."""
    looks: tuple[SeatLook, ...] = ()
    ink_um: Pair = (0.0, 0.0)
    """By how much ink lies off the copper on this board."""
    openings_um: Pair = (0.0, 0.0)


class AlignmentRecord(Made):
    """Where the board lies."""

    what: Literal["alignment"] = "alignment"
    board: str
    side: Literal["top", "bottom"]
    theta_deg: float
    scale: float
    tx_um: float
    ty_um: float
    rms_um: float
    fiducials: tuple[Aligned, ...]
    board_id: str | None = None
    """Which board it was, if the client said so."""
    limits: AlignmentLimits = AlignmentLimits()
    seat: Seat | None = None
    """None: aligned without CAD's layers, by round targets alone."""


MOST_BYTES = 16_000_000
"""No file of a calibration is larger."""
Record = MapRecord | RotationRecord | SurfaceRecord | BacklashRecord | AlignmentRecord
_RECORDS: TypeAdapter[Record] = TypeAdapter(Annotated[Record, Field(discriminator="what")])


def record_file(folder: Path, what: str) -> Path:
    """Return where the present record of a kind is kept."""
    return folder / f"{what}.json"


def read_record(path: Path) -> Record:
    """Read a record; ValueError that names the file if it holds none, OSError if it cannot be read."""
    return parse_record(read_small(path, MOST_BYTES), path.name)


def parse_record(text: str | bytes, name: str) -> Record:
    """Return the record that the content of a file is; anything else is a ValueError that gives the file's name."""
    try:
        return _RECORDS.validate_json(text)
    except ValidationError as exc:
        first = exc.errors()[0]
        where = ".".join(str(p) for p in first["loc"]) or "(file)"
        raise ValueError(f"{name} is no calibration of this program ({where}: {first['msg']})") from exc
