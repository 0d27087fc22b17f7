"""The needles of the studio: four probes of other make, each with its own marking painted by another hand."""

from dataclasses import dataclass, replace

import numpy as np

from tests.vision.studio.needle_body import Array, Body, Hits, stand
from tests.vision.studio.needle_paint import Lamp, Marking, Metal, rim


@dataclass(frozen=True)
class Teeth:
    """Notches in the end: how many round it, how deep (px), and where the first tooth stands (rad)."""

    count: int
    depth_px: float
    first_rad: float = 0.0

    def cut(self, hits: Hits) -> Hits:
        """Return the hits without those in a notch; its inside is not drawn, what lies behind is seen."""
        turn = np.abs(((hits.azimuth - self.first_rad) * self.count / (2 * np.pi) + 0.5) % 1.0 - 0.5) * 2.0
        # A tooth is a triangle with a blunt end.
        notch = self.depth_px * np.clip((turn - 0.15) / 0.85, 0.0, 1.0)
        return replace(hits, met=hits.met & (hits.height >= notch))


@dataclass(frozen=True)
class Kit:
    """One needle: sizes as seen (px); ``rim_px`` and ``band_px`` are measured on the line that is seen as the axis.

    ``point`` (N, 2) is the outline of the end (height, radius) from the very end upwards; ``belly`` rounds the taper
    (0: a straight cone); ``gap_px`` is the bare cylinder between the marking and the taper; ``teeth`` are cut into the
    end, the one at azimuth 0 being seen on the axis.
    """

    radius_px: float
    point: tuple[tuple[float, float], ...]
    belly: float
    rim_px: float
    band_px: float
    gap_px: float
    barrel_px: float
    barrel_radius_px: float
    dip_deg: float
    ragged_px: float
    metal: Metal
    seed: int
    teeth: Teeth | None = None

    def outline(self) -> Array:
        """Return the outline (N, 2) as heights along the needle and radii."""
        c, s = float(np.cos(np.radians(self.dip_deg))), float(np.sin(np.radians(self.dip_deg)))
        # The front of the cylinder is seen lower than its axis, by its radius times the sine of the dip.
        shoulder = (self.rim_px - self.gap_px + self.radius_px * s) / c
        low_height, low_radius = self.point[-1]
        share = np.linspace(0.0, 1.0, 9 if self.belly else 2)[1:]
        taper = np.column_stack(
            [low_height + share * (shoulder - low_height), share + self.belly * share * (1 - share)]
        )
        taper[:, 1] = low_radius + taper[:, 1] * (self.radius_px - low_radius)
        barrel, wide = self.barrel_px / c, self.barrel_radius_px
        stem = [(barrel, self.radius_px), (barrel + 7.0, wide), (barrel + 60.0, wide), (barrel + 62.0, wide - 2.5)]
        stem += [(barrel + 72.0, wide - 2.5), (barrel + 74.0, wide), (4000.0, wide)]
        return np.vstack([self.point, taper, stem])

    def body(self, end_px: tuple[float, float], angle_deg: float) -> Body:
        """Return the needle standing with the end of its axis at a pixel, seen at an angle below the x axis."""
        return stand(self.outline(), end_px, angle_deg, self.dip_deg)

    def marking(self, body: Body) -> Marking:
        """Return its marking: always the same, as paint stays where it was painted."""
        rng = np.random.default_rng(self.seed)
        low, high = body.height_seen_at(self.rim_px), body.height_seen_at(self.rim_px + self.band_px)
        return Marking(low, high, rim(rng, self.ragged_px), rim(rng, 1.5 * self.ragged_px))

    def other(self, rng: np.random.Generator) -> "Kit":
        """Return a needle that is clearly not this one: much thinner or thicker, with a shorter or longer taper."""
        size = float(rng.choice([rng.uniform(0.45, 0.62), rng.uniform(1.45, 1.8)]))
        longer = float(rng.choice([rng.uniform(0.5, 0.65), rng.uniform(1.3, 1.6)]))
        return replace(
            self,
            radius_px=size * self.radius_px,
            barrel_radius_px=size * self.barrel_radius_px,
            rim_px=longer * self.rim_px,
        )


def _round(radius: float, lean: float) -> tuple[tuple[float, float], ...]:
    """Return the outline of a ball end that runs into a cone whose side leans by ``lean`` degrees."""
    turn = np.radians(np.linspace(0.0, 90.0 - lean, 9))
    return tuple((float(h), float(r)) for h, r in zip(radius * (1 - np.cos(turn)), radius * np.sin(turn), strict=True))


_KEY = Lamp(azimuth=-0.45, shine=90.0, width=0.20)
_FILL = Lamp(azimuth=0.75, shine=35.0, width=0.30)
_SECOND = Lamp(azimuth=0.55, shine=80.0, width=0.13)
_BROAD = Lamp(azimuth=0.15, shine=70.0, width=0.40)

KITS = (
    Kit(
        21.0, _round(2.3, 7.0), 0.0, 127.0, 45.0, 4.0, 318.0, 32.0, 30.0, 0.35,
        Metal(150.0, (_KEY, _FILL), 0.02, 10), 100,
    ),
    Kit(
        23.0, ((0.0, 2.4), (0.9, 3.0)), 0.0, 118.0, 40.0, 24.0, 300.0, 36.0, 26.0, 0.5,
        Metal(135.0, (_KEY,), 0.04, 11), 101,
    ),
    Kit(
        19.0, ((0.0, 2.4), (0.8, 3.0), (6.0, 3.0), (9.5, 2.2), (15.0, 2.8)), 0.0,
        138.0, 50.0, 6.0, 335.0, 30.0, 34.0, 0.9,
        Metal(160.0, (_KEY, _SECOND), 0.03, 12), 102,
    ),
    Kit(
        20.0, _round(3.0, 15.0), 0.75, 127.0, 48.0, 5.0, 310.0, 29.0, 22.0, 0.6,
        Metal(145.0, (_BROAD,), 0.06, 13), 103,
    ),
)  # fmt: skip
"""0: sharp cone, ball end; 1: flat end, short cone under a bare cylinder; 2: crown-like head on a neck, two highlights;
3: rounded taper with a big ball end, coarse turning marks."""


def _headed(
    radius_px: float,
    point: tuple[tuple[float, float], ...],
    seed: int,
    *,
    rim_px: float = 118.0,
    dip_deg: float = 28.0,
    metal: Metal | None = None,
    teeth: Teeth | None = None,
) -> Kit:
    """Return a needle with that end; its shaft narrows to the head's last radius, or not at all."""
    finish = metal or Metal(145.0, (_KEY, _FILL), 0.02, seed)
    return Kit(radius_px, point, 0.0, rim_px, 44.0, 22.0, 310.0, radius_px + 11.0, dip_deg, 0.5, finish, seed, teeth)


HEADS = {
    "round_shaft": _headed(12.0, _round(12.0, 0.0), 200),
    "round_thick": _headed(19.0, _round(19.0, 0.0), 201, rim_px=126.0),
    "ball_on_cone": _headed(20.0, _round(7.0, 9.0), 202),
    "flat_shaft": _headed(10.0, ((0.0, 9.0), (1.5, 10.0)), 203),
    "cup_shaft": _headed(14.0, ((0.0, 12.6), (2.0, 14.0)), 204, teeth=Teeth(2, 3.0)),
    "cup_on_cone": _headed(20.0, ((0.0, 7.5), (1.0, 8.5), (20.0, 8.5)), 205),
    "crown_shaft": _headed(13.0, ((0.0, 11.5), (12.0, 13.0)), 206, teeth=Teeth(4, 11.0)),
    "crown_turned": _headed(13.0, ((0.0, 11.5), (12.0, 13.0)), 207, teeth=Teeth(4, 11.0, 0.6)),
    "serrated": _headed(16.0, ((0.0, 15.0), (3.0, 16.0)), 208, teeth=Teeth(8, 6.0)),
    "crown_head": _headed(12.0, ((0.0, 10.0), (4.0, 15.0), (22.0, 15.0), (24.0, 12.0)), 209, teeth=Teeth(4, 9.0)),
    "long_head": _headed(12.0, ((0.0, 13.0), (4.0, 16.0), (52.0, 16.0), (54.0, 12.0)), 210, teeth=Teeth(6, 7.0)),
}
"""Needles that are no points: round, flat, cupped, crowned and serrated ends, on a shaft as wide, on a cone, or on a
head wider than the shaft. The end is where the picture of the foremost points lies on the axis."""
