"""Sections of the touch: the pin, how it goes down, the ladder, the reference pad and the brush."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from daemon.config.sections.base import Finite, Positive, Section
from daemon.domain.point_test import Rung


class TouchSection(Section):
    """How a touch for a measurement goes down, and how often a pad may be touched."""

    overtravel_um: float | None = Field(
        default=None,
        ge=20,
        le=1000,
        description="how far the pin is pushed in where a request says nothing; none: gantry.overtravel_um",
    )
    approach_um: float = Field(
        default=300.0, ge=50, le=2000, description="Z goes slowly from so far above the measured surface"
    )
    dwell_ms: float = Field(default=30.0, ge=0, le=1000, description="the contact has settled after this")
    placed_within_s: float = Field(
        default=60.0, gt=0, le=3600, description="a point is touched no later than this after `place` or `correct`"
    )
    touches_per_pad: int = Field(default=8, ge=1, le=1000, description="of one board in its life, named by `align`")
    presses_per_pad: int = Field(
        default=8, ge=1, le=1000, description="the same for pushes of the pin, with those of pumping"
    )


class PinSection(Section):
    """The sprung pin, from its data sheet."""

    travel_um: float = Field(default=1000.0, ge=100, le=20_000, description="its full stroke")
    preload_n: float = Field(default=0.3, ge=0, le=20, description="force at the beginning of the stroke")
    rate_n_per_mm: float = Field(default=0.6, ge=0, le=100, description="by which the force grows")

    @property
    def stroke_um(self) -> float:
        """How far it may be pushed in: two thirds of its travel, the recommended stroke of makers of spring probes."""
        return self.travel_um * 2 / 3

    def force_n(self, pressed_um: float) -> float:
        """Return its force when it is pushed in; 0 where it is free."""
        return self.preload_n + self.rate_n_per_mm * pressed_um / 1e3 if pressed_um > 0 else 0.0


class SenseSection(Section):
    """Touch sense: an input of the Z drive that closes when the needle stands on metal."""

    kind: Literal["none", "drive_input"] = Field(default="none", description="where it is wired to")
    input: int = Field(default=4, ge=1, le=16, description="drive_input: number of the Z drive's input, as on its plug")
    closed: Literal["high", "low"] = Field(default="high", description="level of the input on metal")


class LadderSection(Section):
    """What a probe does at a point that gives no pass at once, in which order, and what it believes."""

    order: tuple[Rung, ...] = Field(
        default=(Rung.LOOK, Rung.PUMP, Rung.REFERENCE, Rung.SECOND_SITE),
        description="after the first touch: look, pump, reference, second_site; what is left out is never done",
    )
    touches_per_visit: int = Field(default=3, ge=1, le=100, description="descents onto a pad in one test of it")
    pumps: int = Field(default=3, ge=1, le=10, description="strokes between half and full press")
    harder: float = Field(default=1.5, ge=1.0, le=3.0, description="press at a second site, as a share of the first's")
    proof_max_ohm: Positive = Field(default=10.0, description="contact is proved up to this between the needle's wires")
    continuity_max_ohm: Positive = Field(default=10.0, description="a net is whole up to this, where no limit is given")
    settled_share: float = Field(default=0.05, gt=0, le=1, description="three readings that agree within this count")
    settle_max_ms: float = Field(default=500.0, ge=10, le=10_000, description="longest wait for such readings")
    measure_max_ms: float = Field(
        default=6000.0, ge=100, le=60_000, description="of all that is measured in one press; then the needle goes up"
    )
    reference_good_s: float = Field(
        default=60.0,
        gt=0,
        le=3600,
        description="no open is accused unless the reference pad was good so shortly before",
    )

    @model_validator(mode="after")
    def _sensible(self) -> Self:
        if Rung.TOUCH in self.order:
            raise ValueError("order holds what follows the first touch; leave out touch itself")
        if Rung.PATH in self.order:
            raise ValueError("order names no path: it is taken by itself, where an accusation hangs on it")
        if len(set(self.order)) < len(self.order):
            raise ValueError("order names a rung twice")
        return self


class ReferenceSection(Section):
    """The reference pad: gold beside the board, joined to the instrument's return; a good needle reads next to none."""

    x_um: Finite = Field(description="its middle, robot frame")
    y_um: Finite
    z_um: Finite | None = Field(default=None, description="Z at which the needle meets it; none: gantry.touch_z_um")
    max_ohm: Positive = Field(
        default=1.0, description="a needle that reads more is dirty, worn or broken; leads included"
    )
    tare_s: float = Field(
        default=900.0,
        gt=0,
        le=86_400,
        description="age up to which its last reading is subtracted from values; then a run measures it again",
    )

    @property
    def place_um(self) -> tuple[float, float]:
        """Where it is."""
        return self.x_um, self.y_um


class BrushSection(Section):
    """The brush beside the board, onto which a bad needle is lowered."""

    x_um: Finite = Field(description="its middle, robot frame")
    y_um: Finite
    z_um: Finite | None = Field(default=None, description="Z at which the needle meets it; none: gantry.touch_z_um")
    touches: int = Field(default=3, ge=1, le=20, description="so often it is lowered each time")

    @property
    def place_um(self) -> tuple[float, float]:
        """Where it is."""
        return self.x_um, self.y_um
