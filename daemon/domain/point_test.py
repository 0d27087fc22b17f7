"""Test of a point: what is asked about it, and what came of it (design: pass, fail, open or no contact, with proof).

A net is called open only with contact proved in the same press; where that was never proved, nobody knows whether the
pad or the needle was to blame, and the verdict says so.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from daemon.domain.results import Told

PointMethod = Literal[
    "contact", "continuity", "resistance", "fres", "voltage", "diode", "capacitance", "insert"
]  # fmt: skip
"""What is asked; `insert` holds the needle down while the tester injects, and the others measure."""
PointUnit = Literal["ohm", "V", "F"]
UNIT_OF_METHOD: dict[PointMethod, PointUnit | None] = {
    "contact": "ohm", "continuity": "ohm", "resistance": "ohm", "fres": "ohm", "voltage": "V", "diode": "V",
    "capacitance": "F", "insert": None,
}  # fmt: skip


UNIT_WORDS: dict[str, PointUnit] = {
    "ohm": "ohm", "ohms": "ohm", "\u03c9": "ohm", "v": "V", "volt": "V", "volts": "V", "f": "F", "farad": "F",
}  # fmt: skip
"""How testers write the units, in lower case; the sign for ohm is a small omega then."""
TESTER_WORDS = frozenset({"pass", "fail", "open"})
"""What a tester that measures itself may say of a point."""


class PointVerdict(StrEnum):
    """How a point's test ended."""

    PASS_FIRST = "pass_first"  # noqa: S105  # a verdict, no password
    """Within limits at the first touch."""
    PASS_RECOVERED = "pass_recovered"  # noqa: S105  # a verdict
    """Within limits later; `recovered_by` and `cause` say how and why not at once."""
    FAIL = "fail"
    """Contact proved, value outside the limits, twice, and not for what the harness adds."""
    OPEN_CONFIRMED = "open_confirmed"
    """Contact proved in the same press, net open, at two sites or presses, the reference pad good just before, and the
    net's channel known to read, by another point of it that was touched since."""
    CONTACT_NOT_MADE = "contact_not_made"
    """Every rung and the budget spent without a proof of contact."""
    NOT_TESTED = "not_tested"
    """Not reachable, no budget left, the run stopped, the tester silent: `reason` says which."""


PASSES = frozenset({PointVerdict.PASS_FIRST, PointVerdict.PASS_RECOVERED})


class Rung(StrEnum):
    """Steps of the ladder, cheapest and least wearing first; the order in force is data of the configuration."""

    TOUCH = "touch"
    LOOK = "look"
    """Lift, look, correct what is found, touch again."""
    PUMP = "pump"
    """Z between half and full press, reading each time: breaks films, frees a pin that sticks."""
    REFERENCE = "reference"
    """Touch the reference pad; where that is bad, brush and touch it again; a bad needle stops a run."""
    SECOND_SITE = "second_site"
    """Another place within the pad, pressed harder."""
    PATH = "path"
    """Another point of the same net, by which the harness' channel is known to reach the instrument."""


class Cause(StrEnum):
    """Why the first touch gave no pass, as far as what cured it tells."""

    MISPLACED = "misplaced"
    FILM = "film"
    NEEDLE = "needle"
    UNKNOWN = "unknown"


class Limits(BaseModel):
    """Limits of a value, both included; None is no limit on that side."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    low: float | None = Field(default=None, allow_inf_nan=False)
    high: float | None = Field(default=None, allow_inf_nan=False)
    unit: PointUnit

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.low is None and self.high is None:
            raise ValueError("limits need low, high, or both")
        if self.low is not None and self.high is not None and self.low > self.high:
            raise ValueError(f"low {self.low:g} is above high {self.high:g}")
        return self

    def holds(self, value: float) -> bool:
        """Whether a value lies within; an overload (infinite) does where there is no limit on its side."""
        return (self.low is None or value >= self.low) and (self.high is None or value <= self.high)


class PointTest(BaseModel):
    """One line of a plan: what is asked about one point."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    point: str = Field(min_length=1, max_length=120, description="its name in the board file")
    net: str | None = Field(default=None, description="its net; a plan of another board is recognised by it")
    method: PointMethod = "continuity"
    limits: Limits | None = Field(default=None, description="of the value; `contact` and `insert` need none")
    theta_deg: float | None = Field(default=None, allow_inf_nan=False, description="angle of the head; none: any")
    look: Literal["first", "on_open"] = Field(default="on_open", description="look before the first touch, or after")
    touches: int | None = Field(default=None, ge=1, le=100, description="budget of this point; none: configuration")
    second_site: bool = Field(default=True, description="whether another place within the pad may be touched")
    note: str = Field(default="", max_length=500)

    @model_validator(mode="after")
    def _unit_fits(self) -> Self:
        unit = UNIT_OF_METHOD[self.method]
        if self.limits is not None and self.limits.unit != unit:
            raise ValueError(
                f"{self.method} is measured in {unit or 'nothing'}, and its limits are in {self.limits.unit}"
            )
        return self


@dataclass(frozen=True)
class PadWear:
    """How often a pad was touched and pressed, in all and in the visit that is asked about."""

    touches: int
    presses: int
    touches_in_visit: int
    presses_in_visit: int


class PointReading(Told):
    """One press of a point and what was read in it."""

    rung: Rung
    site_um: tuple[float, float] = Field(description="aimed at, from the pad's place, board frame, um")
    pressed_um: float
    force_n: float
    proof: bool | None = Field(description="contact proved in this press; None: nobody asked, or nothing can prove it")
    contact_ohm: float | None = Field(
        default=None,
        description="between the needle's own two wires, by which it is proved; None: none flowed, or unasked",
    )
    tare_ohm: float | None = Field(
        default=None, description="taken off `value` for leads and needle, as the reference pad read it; None: nothing"
    )
    tare_age_s: float | None = Field(default=None, description="how long before the reference pad had read that")
    seen: bool = Field(default=False, description="the eye had seen the pad below the tip since it was last there")
    said: str | None = Field(default=None, description="the tester's own word, where it measured")
    value: float | None = Field(description="in `unit`; None: not read, or an overload")
    overload: bool = Field(default=False, description="beyond what can be measured, as an open is")
    unit: PointUnit | None


class PointRecord(Told):
    """What came of one point's test."""

    point: str
    net: str | None
    board_id: str | None
    method: PointMethod
    limits: Limits | None
    verdict: PointVerdict
    run: str | None = Field(default=None, description="of which it is a part; None: asked for alone")
    plan_hash: str | None = Field(
        default=None, description="fingerprint of the run's plan, by which it is known which limits were asked for"
    )
    reason: str = Field(default="", description="in words, where the verdict alone does not tell")
    fault: str | None = Field(
        default=None, description="name of the trouble that ended its test; None: the ladder came to its end"
    )
    recovered_by: Rung | None = None
    cause: Cause | None = None
    readings: tuple[PointReading, ...] = ()
    touches: int = Field(default=0, description="descents onto the pad")
    elsewhere: int = Field(
        default=0, description="descents onto other points of the net, to see whether its channel reads at all"
    )
    presses: int = Field(default=0, description="pushes of the pin, with those of pumping")
    looks: int = 0
    error_um: float | None = Field(default=None, description="by how much the tip was off when first looked at")
    sigma_um: float | None = None
    seconds: float
    at: str = Field(description="UTC, ISO 8601")
    pictures: str | None = Field(default=None, description="folder of the kept pictures on the station")

    @property
    def first_value(self) -> float | None:
        """What the first press read."""
        return self.readings[0].value if self.readings else None

    @property
    def last_value(self) -> float | None:
        """What the last press read."""
        return self.readings[-1].value if self.readings else None
