"""CAD layers of one side of a board as a board file keeps them: flat lists of whole micrometres.

An outline is `x, y, x, y, ...` in that side's own board frame (origin at the outline's lower left corner as seen from
the side, x right, y up). Painting order counts: a later outline covers or, if listed in `removes`, removes what
earlier ones drew. `SideShapes.layers` is the same as arrays, which registration works with.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

if TYPE_CHECKING:  # most who read a board register none, and are not to wait for it
    from vision.registration import Hole, Polygon, SideLayers

FARTHEST_UM = 2_000_000
"""No board is 2 m long: a number beyond it is a broken file."""


def _closed(outline: tuple[int, ...]) -> tuple[int, ...]:
    if len(outline) < 6 or len(outline) % 2:
        raise ValueError(f"an outline has {len(outline)} numbers; it takes three or more pairs x, y")
    return outline


Um = Annotated[int, Field(ge=-FARTHEST_UM, le=FARTHEST_UM)]
Outline = Annotated[tuple[Um, ...], AfterValidator(_closed)]


def as_points(outline: tuple[int, ...]) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Return an outline's corners, (N, 2) um."""
    return np.array(outline, dtype=np.float64).reshape(-1, 2)


class _Shapes(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Painting(_Shapes):
    """Filled outlines in painting order; `removes`: the places in `outlines` of those that remove."""

    outlines: tuple[Outline, ...] = ()
    removes: tuple[int, ...] = ()

    @model_validator(mode="after")
    def _removes_what_is_there(self) -> Painting:
        if any(not 0 <= i < len(self.outlines) for i in self.removes):
            raise ValueError("removes names an outline that is not there")
        return self

    def polygons(self) -> tuple[Polygon, ...]:
        """Return them as arrays."""
        from vision.registration import Polygon  # noqa: PLC0415  # as above

        removes = frozenset(self.removes)
        return tuple(Polygon(as_points(o), dark=i not in removes) for i, o in enumerate(self.outlines))


class HoleShape(_Shapes):
    """A drilled hole, or a slot to `end_um`; `covered`: mask or a cap hides it from this side."""

    x_um: float
    y_um: float
    diameter_um: float = Field(gt=0.0, le=FARTHEST_UM)
    end_um: tuple[float, float] | None = None
    plated: bool = True
    covered: bool = False


class Body(_Shapes):
    """A part on this side: its outline as seen from above, and how high it stands where that is known."""

    outline: Outline
    part: str | None = None
    height_um: float | None = None


class SideShapes(_Shapes):
    """All that CAD says of one side. soldered: pads that carry solder or a lead."""

    copper: Painting = Painting()
    openings: Painting = Painting()
    ink: Painting = Painting()
    holes: tuple[HoleShape, ...] = ()
    outline: Painting = Painting()
    bodies: tuple[Body, ...] = ()
    soldered: Painting = Painting()

    @cached_property
    def layers(self) -> SideLayers:
        """The same as arrays; made when first asked for, then kept."""
        from vision.registration import Polygon, SideLayers  # noqa: PLC0415  # as above

        return SideLayers(
            copper=self.copper.polygons(),
            openings=self.openings.polygons(),
            ink=self.ink.polygons(),
            holes=tuple(_hole(h) for h in self.holes),
            outline=self.outline.polygons(),
            bodies=tuple(Polygon(as_points(b.outline)) for b in self.bodies),
            soldered=self.soldered.polygons(),
        )


def _hole(shape: HoleShape) -> Hole:
    from vision.registration import Hole  # noqa: PLC0415  # as above

    end_x_um, end_y_um = shape.end_um or (None, None)
    return Hole(shape.x_um, shape.y_um, shape.diameter_um, end_x_um, end_y_um, shape.plated, shape.covered)


class BoardLayers(_Shapes):
    """Both sides, each in its own frame; the other one tells registration of a board that lies wrong side up."""

    top: SideShapes
    bottom: SideShapes
