"""Knobs: every imperfection of the station and every unsettled point of the drive manual, as one frozen value."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints


@dataclass(frozen=True)
class Knobs:
    """Hold all knobs; `None` means "drawn from the seed". Names are those of `--set` and of the bench `set`."""

    # --- the board in its fixture: translation and rotation about the outline's centre, height, tilt
    board_dx_um: float | None = None
    board_dy_um: float | None = None
    board_rotation_deg: float | None = None
    board_dz_um: float | None = None
    board_tilt_x_um_per_mm: float | None = None
    board_tilt_y_um_per_mm: float | None = None
    board_shift_max_um: float = 200.0
    board_rotation_max_deg: float = 0.2
    board_height_sigma_um: float = 15.0
    board_tilt_sigma_um_per_mm: float = 0.2

    # --- the board as it was made; shifts are against the copper, as this side is seen, x right and y up
    board_mask: Literal["green", "red", "blue", "black", "white"] = "green"
    board_metal: Literal["gold", "hasl"] = "gold"
    """`hasl`: molten tin, domed, its glints wander over each pad."""
    board_oxide: float = 0.0
    """How tarnished bare metal is, 0..1."""
    board_ink_dx_um: float = 0.0
    board_ink_dy_um: float = 0.0
    board_openings_dx_um: float = 0.0
    board_openings_dy_um: float = 0.0
    """Shift of the openings of the solder mask."""
    board_dirt_per_cm2: float = 0.0
    """Spots of all sizes and levels; a picture shows some two square centimetres."""
    board_marks: int = 0
    """1: the needle leaves a dent in the metal it touches, to be seen from then on."""

    # --- the control-point card beside the board: shift, rotation about its centre, height
    card_dx_um: float | None = None
    card_dy_um: float | None = None
    card_rotation_deg: float | None = None
    card_dz_um: float | None = None
    card_shift_max_um: float = 100.0
    card_rotation_max_deg: float = 1.0
    card_height_sigma_um: float = 15.0

    # --- reference coin and brush, each beside its nominal place and height
    spots_shift_max_um: float = 150.0
    spots_height_sigma_um: float = 15.0

    # --- where the axes stand at power-up (X and Y 5..15 mm from home, Z high, theta anywhere)
    x_start_um: float | None = None
    y_start_um: float | None = None
    z_start_um: float | None = None
    theta_start_deg: float | None = None

    # --- mechanics
    x_backlash_um: float = 15.0
    y_backlash_um: float = 15.0
    z_backlash_um: float = 0.0
    theta_backlash_deg: float = 0.0
    repeatability_um: float = 8.0
    """Planar error of a stop, one sigma; each of X and Y draws it divided by sqrt(2)."""
    z_repeatability_um: float = 2.0
    theta_repeatability_deg: float = 0.0
    home_repeatability_um: float = 3.0
    """How well a homing finds the same edge again, one sigma."""
    theta_home_repeatability_deg: float = 0.01
    estop_slip_um: float = 40.0
    """Slip of a linear axis whose power is cut while it moves, one sigma."""
    head_runout_scale: float = 1.0

    pin_travel_um: float = 1000.0
    """How far the probe's plunger can be pushed in; what is lowered further presses with the whole pin."""

    head_from_um: float = 15_000.0
    """How high the lowest of the head, camera and lamps too, is above the free needle's end."""

    # --- lights
    lamp_rise_s: float = 0.015
    relay_delay_s: float = 0.008
    relay_bounce_s: float = 0.002

    # --- the image; read by the camera
    camera_frame_period_s: float = 1.0 / 15.0
    camera_blur_px: float = 1.0
    camera_noise_grey: float = 3.0
    camera_falloff: float = 0.15
    camera_glint: float = 0.3
    """Chance of a glint in a frame."""
    camera_flex_px: float = 0.7
    """Spread of the tip's place in the image between stops, one sigma."""

    # --- the line
    think_min_ms: float = 1.0
    think_max_ms: float = 2.0
    bus_gap_ms: float = 3.0
    """A request that begins sooner than this after the last reply is lost (drive manual, "General"); paced line
    only."""

    # --- drive configuration as saved in its memory
    position_unit: int = 0x00B50000
    speed_unit: int = 0x00B44700
    special_function_enable: int = 0x7
    """3240h:01; a drive may well come with 0: then no input acts as a switch."""
    quick_stop_option: int = 2
    limit_reaction: int = 2
    """3701h, in a positioning move: below 0 none, 0 voltage off, 1 brake with 6084h, 2 brake with 6085h; then fault."""

    drive_boot_s: float = 0.5
    """A drive does not answer for so long after power-up."""

    # --- points the drive manual leaves open
    fc43_index_order: Literal["big", "little"] = "big"
    fc43_node: int = -1
    """Accepted NODE byte: -1 takes the slave's own id or 1, any other value only itself."""
    fc43_write_flag: int = 0x01
    fc43_write_num: Literal["echo", "zero"] = "echo"
    fc43_abort_order: Literal["big", "little"] = "little"
    word_order: Literal["high", "low"] = "high"
    home_offset_sign: int = -1
    """Position shown at the home edge is this sign times 607Ch (CiA 402: zero = home + offset, hence -1)."""
    outside_limits: Literal["refuse", "clamp"] = "refuse"
    """What happens to a target outside 607Dh."""

    # --- what happens electrically where the needle stands (sim_hw/electric); shares are 0..1, all figures are guesses
    board_number: int = 0
    """Which board of its series lies in the nest: each has broken nets and films of its own."""
    open_share: float = 0.0
    """Nets with a broken trace."""
    short_share: float = 0.0
    """Nets shorted to a neighbour."""
    misplaced_share: float = 0.0
    """Ways of X and Y that end up to `misplaced_um` beside their place, until the next way."""
    misplaced_um: float = 400.0
    oxide_share: float = 0.0
    """Pads with a film that a press or two breaks."""
    stubborn_share: float = 0.0
    """Pads with a film that hardly breaks, or with a pool of flux on one half."""
    debris_share: float = 0.0
    """Touches that leave something on the needle."""
    harness_ohm: float = 0.0
    tip_radius_um: float = 25.0
    tip_wear_um: float = 0.0
    """By which each touch shortens the needle."""
    pin_preload_n: float = 0.3
    pin_rate_n_per_mm: float = 0.6
    dent_n: float = 0.9
    """Force above which a pad is dented."""
    contact_bounce_s: float = 0.015
    """Longest bounce of a touch; each draws its own."""
    sense_fitted: int = 1
    """Whether the touch sense is wired to raw input 4 of the Z drive (60FDh bit 19)."""
    sense_delay_s: float = 0.002
    meter_lead_ohm: float = 0.15
    meter_open_v: float = 0.2
    """Voltage that the meter's ohms and continuity put across an open pair of leads: high ones break films."""

    def with_value(self, name: str, value: object) -> Knobs:
        """Return the knobs with one changed; text is converted to the knob's type.

        Raises:
            ValueError: no such knob, or the value does not fit its type.

        """
        hints = get_type_hints(type(self))
        if name not in hints:
            raise ValueError(f"unknown knob {name!r}; known: {', '.join(self.names())}")
        changed: dict[str, Any] = {name: _converted(name, hints[name], value)}
        return replace(self, **changed)

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Return the names of all knobs."""
        return tuple(field.name for field in fields(cls))


def _converted(name: str, hint: object, value: object) -> object:
    options = get_args(hint)
    if get_origin(hint) is Literal:
        if value not in options:
            raise ValueError(f"knob {name!r} must be one of {', '.join(map(str, options))}, not {value!r}")
        return value
    if get_origin(hint) in (Union, UnionType):
        if value is None or value in ("none", "None"):
            return None
        hint = options[0]
    try:
        number = _number(value)
    except ValueError:
        raise ValueError(f"knob {name!r} must be a number, not {value!r}") from None
    if hint is not int:
        return float(number)
    if number != int(number):
        raise ValueError(f"knob {name!r} must be a whole number, not {value!r}")
    return int(number)


def _number(value: object) -> float | int:
    """Return a finite number from JSON or text (hexadecimal too)."""
    if isinstance(value, str):
        number: float | int = int(value, 0) if value.lower().startswith("0x") else float(value)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        number = value
    else:
        raise ValueError(value)  # noqa: TRY004 - the caller turns every unfit value into one message
    if not math.isfinite(number):
        raise ValueError(value)
    return number
