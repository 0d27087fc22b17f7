"""What the lamps promise. No I/O."""

from enum import Enum
from typing import Protocol

from drivers.deadline import Deadline


class Light(Enum):
    """Which ring is on; there is no value for both, they would blind each other's picture."""

    OFF = "off"
    WHITE = "white"
    RED = "red"


class Lights(Protocol):
    """Two lamp rings of which at most one is on."""

    @property
    def settle_s(self) -> float:
        """Time from a switch until the light is steady."""

    async def set(self, light: Light, deadline: Deadline) -> None:
        """Switch; returns when the relay has confirmed it. Raises LightError or LinkError."""

    async def check(self, deadline: Deadline) -> None:
        """Raise LightError unless the relay still shows what it was told last; one that says nothing is believed."""

    async def close(self) -> None:
        """Go dark and let go of the hardware. Raises when it cannot go dark."""
