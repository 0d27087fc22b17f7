"""Section of the measuring instrument between needle and harness."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, field_validator, model_validator

from daemon.config.sections.base import Positive, Section
from drivers.meter import DEFAULT_FUNCTIONS, WITHOUT_NPLC, WITHOUT_RANGE, Function, Method, parse_address

ScpiText = Annotated[str, Field(min_length=1, max_length=200, pattern=r"^[ -~]+$")]
"""One message to an instrument: ASCII in one line."""


class MeterMethodSection(Section):
    """How one method is measured."""

    function: Function | None = Field(default=None, description="of the instrument; none: the method's own")
    range: Positive | None = Field(default=None, description="largest value expected, ohm, V or F; none: automatic")
    nplc: Positive | None = Field(default=None, description="integration time in cycles of the mains")
    commands: tuple[ScpiText, ...] = Field(default=(), description="instead of CONF: for an instrument of other words")
    read: ScpiText = Field(default="READ?", description="what is asked for one reading")

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if self.commands and not (self.range is None and self.nplc is None):
            raise ValueError("with commands of its own, range and nplc belong into them")
        return self

    def function_of(self, method: Method) -> Function:
        """Return what the instrument measures for a method."""
        return self.function or DEFAULT_FUNCTIONS[method]


class MeterSection(Section):
    """The measuring instrument between needle and harness; without this section there is none."""

    kind: Literal["scpi"]
    address: str = Field(description="host:port of its SCPI socket, or a serial port")
    baudrate: int = Field(default=9600, ge=300, le=1_000_000, description="on a serial port (8N1)")
    terminator: Literal["lf", "crlf", "cr"] = Field(default="lf", description="ends commands and answers")
    answer_ms: float = Field(default=2000.0, ge=10, le=60_000, description="longest wait for one answer")
    model: str | None = Field(default=None, min_length=1, description="in its *IDN?; another one is refused")
    setup: tuple[ScpiText, ...] = Field(default=(), description="sent after opening, such as SYST:REM")
    close_channels: ScpiText = Field(default="ROUT:CLOS (@{channels})", description="of its scanner")
    open_channels: ScpiText = Field(default="ROUT:OPEN:ALL", description="of its scanner")
    channels: dict[str, Annotated[int, Field(ge=0)]] = Field(
        default={}, description="scanner channel of each net's pin of the harness"
    )
    contact_channel: int | None = Field(
        default=None, ge=0, description="scanner channel of the needle's second wire, by which contact is proved"
    )
    ground_net: str | None = Field(
        default=None, min_length=1, description="net against which voltage, diode and capacitance are measured"
    )
    methods: dict[Method, MeterMethodSection] = Field(default={}, description="what differs from the methods' own")

    @field_validator("address")
    @classmethod
    def _an_address(cls, given: str) -> str:
        parse_address(given)
        return given

    @field_validator("close_channels")
    @classmethod
    def _with_their_numbers(cls, given: str) -> str:
        if "{channels}" not in given:
            raise ValueError(
                f"{given!r} has no {{channels}}, which is where their numbers go: ROUT:CLOS (@{{channels}})"
            )
        return given

    @model_validator(mode="after")
    def _fits(self) -> Self:
        for method, given in self.methods.items():
            function = given.function_of(method)
            if given.nplc is not None and function in WITHOUT_NPLC:
                raise ValueError(f"methods.{method.value}: {function.value} has no nplc")
            if given.range is not None and function in WITHOUT_RANGE:
                raise ValueError(f"methods.{method.value}: {function.value} has no range")
        return self
