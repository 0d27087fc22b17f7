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

    async def set(self, light: Light, deadline: Deadline) -> float:
        """Switch, and return when it was switched at the latest (CLOCK_MONOTONIC), once the relay has confirmed it.

        A lamp that shines already was switched then. Raises LightError or LinkError.
        """

    async def check(self, deadline: Deadline) -> None:
        """Raise LightError unless the relay still shows what it was told last; one that says nothing is believed.

        Raises DeadlinePassed where the time was too short to ask.
        """

    async def close(self) -> None:
        """Go dark and let go of the hardware. Raises when it cannot go dark."""
