"""Contact of the needle: what is told of a touch while the needle stands on the board."""

from __future__ import annotations

from pydantic import Field

from daemon.domain.results import Told


class ContactFacts(Told):
    """The needle stands."""

    id: str = Field(description="of the touch; `hold` and `lift` name it")
    press: int = Field(default=1, description="which press of this job it is, from 1; a `lift` may name it")
    test_point: str
    board_id: str | None
    z_um: float = Field(description="where Z stands")
    pressed_um: float = Field(description="how far the pin is pushed in, by the measured surface")
    force_n: float = Field(description="of the pin at that, by its data sheet")
    since: str = Field(description="UTC, ISO 8601")
