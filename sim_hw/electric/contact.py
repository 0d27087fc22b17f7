"""Contact: what lies under the end of the needle, and how much of that end stands on which pad's bare metal."""

from __future__ import annotations

from dataclasses import dataclass

from sim_hw.board.nest import InNest

METAL = "metal"


@dataclass(frozen=True)
class Patch:
    """A share (0..1) of the needle's end on one material; on metal with its net, its pad, and that pad's middle."""

    material: str
    share: float
    net: str | None = None
    pad: str | None = None
    centre_mm: tuple[float, float] | None = None

    @property
    def key(self) -> str | None:
        """Return a name of the pad that no other pad has: vias share theirs."""
        return None if self.centre_mm is None else f"{self.pad}@{self.centre_mm[0]:.3f},{self.centre_mm[1]:.3f}"


@dataclass(frozen=True)
class Footing:
    """All that lies under the needle's end, the largest share first."""

    patches: tuple[Patch, ...]

    @property
    def material(self) -> str:
        """Return what most of the end stands on."""
        return self.patches[0].material

    @property
    def metal_share(self) -> float:
        """Return how much of the end is on bare metal."""
        return sum(patch.share for patch in self.patches if patch.material == METAL)

    def held_by(self, least_share: float) -> tuple[Patch, ...]:
        """Return the pieces of metal that carry enough of the end for a current: two of them are bridged."""
        return tuple(patch for patch in self.patches if patch.material == METAL and patch.share >= least_share)


def under(nest: InNest, x_mm: float, y_mm: float, radius_um: float) -> Footing:
    """Return what the needle's end, a disc, stands on at a CAD place."""
    if nest.bodies.over(x_mm, y_mm) is not None:
        return standing_on("body")
    patches = []
    for one in nest.surface.under(x_mm, y_mm, radius_um):
        pad = one.pad
        named = () if pad is None else (pad.net or None, pad.name, (pad.x_mm, pad.y_mm))
        patches.append(Patch(one.what, one.share, *named))
    return Footing(tuple(patches))


def standing_on(material: str, net: str | None = None) -> Footing:
    """Return a footing of one material, such as that of the reference coin."""
    return Footing((Patch(material, 1.0, net, net),))
