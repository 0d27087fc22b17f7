"""A needle as a solid of revolution before a pinhole camera, seen by casting rays (no distance fields).

Unit of length: one pixel at the depth of the needle's end, so that the camera stands ``FOCAL_PX`` units away from it.
Camera frame: x right, y down, z away from the camera; pixel centres at integers.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]

FOCAL_PX = 3750.0
"""Thesis section 3 for the station's webcam: about 2000 / tan(28.1 deg)."""
CENTRE_PX = np.array([799.5, 599.5])
SHAPE = (1200, 1600)


@dataclass(frozen=True)
class Body:
    """A solid of revolution: ``outline`` (N, 2) holds (height above the end, radius) with rising heights.

    ``end`` (3,) is where the axis pierces height zero, ``up`` (3,) the axis' unit direction away from the end.
    """

    outline: Array
    end: Array
    up: Array

    @property
    def facing(self) -> Array:
        """Unit vector (3,) across the axis, towards the camera: it spans the plane that is seen as the axis."""
        towards = -self.end - (-self.end @ self.up) * self.up
        facing: Array = towards / np.linalg.norm(towards)
        return facing

    def radius(self, height: float) -> float:
        """Return the radius at one height."""
        return float(np.interp(height, self.outline[:, 0], self.outline[:, 1]))

    def front_px(self, height: float) -> Array:
        """Return where (2,) the surface line nearest to the camera is seen at one height."""
        return project(self.end + height * self.up + self.radius(height) * self.facing)

    def axis_direction(self) -> Array:
        """Return the unit direction (2,) in which the seen axis runs, towards the end."""
        across = project(self.end) - project(self.end + 100.0 * self.up)
        direction: Array = across / np.linalg.norm(across)
        return direction

    def seen_end_px(self) -> Array:
        """Return the last point (2,) of the picture of the body on the picture of its axis.

        Rays seen on the axis lie in one plane with it, in which the body is the area between its outline and the
        mirrored outline; the farthest corner of that area is the end of the picture.
        """
        heights, radii = self.outline[:, :1], self.outline[:, 1:]
        sides = [self.end + heights * self.up + sign * radii * self.facing for sign in (1.0, -1.0)]
        corners = project(np.concatenate(sides))
        along = corners @ self.axis_direction()
        farthest: Array = corners[int(np.argmax(along))]
        return farthest

    def height_seen_at(self, above_end_px: float) -> float:
        """Return the height whose front is seen ``above_end_px`` before the seen end, by bisection."""
        low, high = 0.0, 4.0 * above_end_px
        last, direction = self.seen_end_px(), self.axis_direction()
        for _ in range(60):
            middle = (low + high) / 2
            if float((last - self.front_px(middle)) @ direction) < above_end_px:
                low = middle
            else:
                high = middle
        return (low + high) / 2


@dataclass(frozen=True)
class Hits:
    """Surface points met by K rays in each of P pixels: (P, K) arrays; ``met`` says which rays met the body.

    ``azimuth`` (rad) is zero on the side facing the camera; ``normal`` points outwards in the camera frame; ``lean``
    is the share of the normal along the axis towards the end (0 on a cylinder).
    """

    rows: Index
    cols: Index
    met: npt.NDArray[np.bool_]
    height: Array
    azimuth: Array
    normal: tuple[Array, Array, Array]
    lean: Array


def project(points: Array) -> Array:
    """Return the pixel positions (..., 2) of points (..., 3) in the camera frame."""
    seen: Array = FOCAL_PX * points[..., :2] / points[..., 2:] + CENTRE_PX
    return seen


def stand(outline: Array, end_px: tuple[float, float], angle_deg: float, dip_deg: float) -> Body:
    """Return a body whose axis ends at pixel ``end_px`` and is seen running down at ``angle_deg`` below the x axis.

    ``dip_deg`` is the angle at which the axis leaves the picture plane: the end is farther away than the barrel.
    """
    end = np.array([*(np.asarray(end_px) - CENTRE_PX), FOCAL_PX])
    angle, dip = np.radians(angle_deg), np.radians(dip_deg)
    # Off the optical axis depth moves the picture too; the second term takes that out of the seen direction.
    flat = -np.cos(dip) * np.array([np.cos(angle), np.sin(angle)]) - np.sin(dip) * end[:2] / FOCAL_PX
    up = np.array([*flat, -np.sin(dip)])
    return Body(outline, end, up / np.linalg.norm(up))


def bend(body: Body, height: float, angle_deg: float) -> tuple[Body, Body]:
    """Return the straight upper part and the lower part turned in the picture plane about the axis at ``height``."""
    pivot = body.end + height * body.up
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    up = np.array([c * body.up[0] - s * body.up[1], s * body.up[0] + c * body.up[1], body.up[2]])
    heights, radius = body.outline[:, 0], body.radius(height)
    above = np.vstack([[height, radius], body.outline[heights > height]])
    overlap = radius * abs(s) + 1.0
    below = np.vstack([body.outline[heights < height], [height, radius], [height + overlap, radius - 0.3]])
    return Body(above, body.end, body.up), Body(below, pivot - height * up, up)


def cast(body: Body, fine_px: float = 45.0, rays: int = 4, fine_rays: int = 8) -> list[Hits]:
    """Return what the rays of all pixels near the body meet; rays are denser within ``fine_px`` of the seen end."""
    rows, cols, along = _near(body)
    close = along < fine_px
    groups = ((close, fine_rays), (~close & (along < 400.0), rays), (~close & (along >= 400.0), max(2, rays // 2)))
    return [_meet(body, rows[mask], cols[mask], along[mask], count) for mask, count in groups if mask.any()]


def _near(body: Body) -> tuple[Index, Index, Array]:
    last, direction = body.seen_end_px(), body.axis_direction()
    # The needle comes from above: nothing of it is seen right of its end or below it, but for its own width.
    margin = float(body.outline[:, 1].max()) + 4.0
    bottom, right = (int(np.clip(v + margin, 0, n)) for v, n in zip(last[::-1], SHAPE, strict=True))
    y = np.arange(bottom, dtype=np.float64)[:, None] - last[1]
    x = np.arange(right, dtype=np.float64)[None, :] - last[0]
    along = -(x * direction[0] + y * direction[1])
    across = np.abs(y * direction[0] - x * direction[1])
    rows, cols = np.nonzero((along > -3.0) & (across < 1.3 * margin))
    kept = across[rows, cols] < _reach(body, along[rows, cols])
    rows, cols = rows[kept], cols[kept]
    return rows, cols, along[rows, cols]


def _reach(body: Body, along: Array) -> Array:
    heights, radii = body.outline[:, 0], body.outline[:, 1]
    fronts = project(body.end + heights[:, None] * body.up)
    seen = (body.seen_end_px() - fronts) @ body.axis_direction()
    slack = float(radii.max())
    wide = np.array([radii[np.abs(seen - s) <= slack].max() for s in seen])
    return np.interp(along, seen, 1.12 * wide) + 3.0


def _meet(body: Body, rows: Index, cols: Index, along: Array, count: int) -> Hits:
    step = (np.arange(count) + 0.5) / count - 0.5
    dy, dx = (grid.ravel() for grid in np.meshgrid(step, step, indexing="ij"))
    ray_x = cols[:, None] + dx - CENTRE_PX[0]
    ray_y = rows[:, None] + dy - CENTRE_PX[1]
    depth = np.full(ray_x.shape, np.inf)
    slope = np.zeros(ray_x.shape)
    spans = _spans(body)
    for (s0, r0), (s1, r1), (low, high) in zip(body.outline[:-1], body.outline[1:], spans, strict=True):
        near = np.nonzero((along > low) & (along < high))[0]
        if near.size:
            k = (r1 - r0) / (s1 - s0)
            found = _frustum(body, ray_x[near], ray_y[near], (s0, s1, r0, k))
            closer = found < depth[near]
            depth[near] = np.where(closer, found, depth[near])
            slope[near] = np.where(closer, k, slope[near])
    return _surface(body, rows, cols, (ray_x, ray_y), depth, slope)


def _spans(body: Body) -> list[tuple[float, float]]:
    """Return for each frustum the range of distances before the seen end at which a pixel can show it."""
    last, direction = body.seen_end_px(), body.axis_direction()
    heights, radii = body.outline[:, :1], body.outline[:, 1:]
    front = (last - project(body.end + heights * body.up + radii * body.facing)) @ direction
    back = (last - project(body.end + heights * body.up - radii * body.facing)) @ direction
    low, high = np.minimum(front, back), np.maximum(front, back)
    return [(min(low[i : i + 2]) - 2.0, max(high[i : i + 2]) + 2.0) for i in range(len(low) - 1)]


def _frustum(body: Body, ray_x: Array, ray_y: Array, part: tuple[float, float, float, float]) -> Array:
    """Return where rays first meet one frustum: m in (1 + m) * ray, infinite where they miss."""
    s0, s1, r0, k = part
    ux, uy, uz = body.up
    # Starting at the depth of the needle's end keeps the numbers small.
    px, py, pz = ray_x - body.end[0], ray_y - body.end[1], FOCAL_PX - body.end[2]
    height0 = px * ux + py * uy + pz * uz
    rate = ray_x * ux + ray_y * uy + FOCAL_PX * uz
    radius0 = r0 + k * (height0 - s0)
    a = ray_x**2 + ray_y**2 + FOCAL_PX**2 - (1 + k * k) * rate**2
    b = px * ray_x + py * ray_y + pz * FOCAL_PX - height0 * rate - k * rate * radius0
    c = px**2 + py**2 + pz**2 - height0**2 - radius0**2
    with np.errstate(invalid="ignore", divide="ignore"):
        root = np.sqrt(b * b - a * c)
        best = np.full(ray_x.shape, np.inf)
        for m in ((-b - root) / a, (-b + root) / a):
            height = height0 + m * rate
            valid = (height >= s0) & (height <= s1) & (r0 + k * (height - s0) >= 0)
            best = np.where(valid & (m < best), m, best)
    return best


def _surface(body: Body, rows: Index, cols: Index, ray: tuple[Array, Array], depth: Array, slope: Array) -> Hits:
    met = np.isfinite(depth)
    m = np.where(met, depth, 0.0)
    point = (ray[0] * (1 + m) - body.end[0], ray[1] * (1 + m) - body.end[1], FOCAL_PX * (1 + m) - body.end[2])
    height = sum(p * u for p, u in zip(point, body.up, strict=True))
    out = [p - height * u for p, u in zip(point, body.up, strict=True)]
    size = np.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2) + 1e-9
    side = np.cross(body.up, body.facing)
    aside = sum(o * v for o, v in zip(out, side, strict=True))
    ahead = sum(o * v for o, v in zip(out, body.facing, strict=True))
    level = 1.0 / np.sqrt(1.0 + slope**2)
    nx, ny, nz = ((o / size - slope * u) * level for o, u in zip(out, body.up, strict=True))
    return Hits(rows, cols, met, np.asarray(height), np.arctan2(aside, ahead), (nx, ny, nz), slope * level)
