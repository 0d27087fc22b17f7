"""The pinhole camera: world points to pixels, and pixels back along their rays (thesis ch. 3).

Camera frame: x right, y down, z along the optical axis, origin in the centre of projection, so that a point seen has a
positive depth. (The thesis puts the image *behind* the centre, but its eq. 3.4 carries no minus: it is the upright
image in front.) World frame: right-handed, um; any other length unit works as well if it is used throughout.
Lens distortion is not modelled, as in the thesis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vision.geometry.frames import Array, rotation

LEAST_SLOPE = 1e-9
"""A ray that meets a plane at less than this slope (sine of the angle) runs along it."""


def check_points(points: Any, name: str, columns: int) -> Array:
    """Return `points` as float64 of shape (columns,) or (N, columns), else raise ValueError naming the argument."""
    try:
        array = np.asarray(points)
    except (TypeError, ValueError) as exc:
        raise ValueError(f"{name} must be numbers, shape ({columns},) or (N, {columns}): {exc}") from exc
    if array.dtype.kind not in "iuf" or array.ndim not in (1, 2) or array.shape[-1] != columns:
        raise ValueError(
            f"{name} must be real numbers, shape ({columns},) or (N, {columns}); got {array.dtype} of {array.shape}"
        )
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite; leave out the points that were not found")
    return array.astype(np.float64)


def _check_numbers(record: Any) -> None:
    """Raise ValueError when a field of a dataclass of numbers is not a finite number."""
    for field in fields(record):
        value = getattr(record, field.name)
        if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not math.isfinite(value):
            raise ValueError(f"{field.name} must be a finite number, got {value!r}")


def _check_positive(**values: float) -> None:
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0.0):
            raise ValueError(f"{name} must be finite and greater than 0, got {value!r}")


def view_angle_deg(size: float, focal: float) -> float:
    """Return the full angle of view of a sensor `size` wide behind the focal length `focal`, in one unit (mm or px).

    The thesis prints `alpha = 2 atan(d / f)` before fig. 3.7, which is right for half the sensor only: the full size
    `d` needs `d / 2`, as its own eq. 3.26 and 3.27 have it (`f = c / tan(angle / 2)`, with `c` half the image).
    Raises ValueError unless both are finite and positive.
    """
    _check_positive(size=size, focal=focal)
    return math.degrees(2.0 * math.atan2(size, 2.0 * focal))


def view_angle_from_target_deg(target_um: float, target_px: float, picture_px: float, distance_um: float) -> float:
    """Return the full angle of view from a target of known size seen square on (thesis, after fig. 3.5).

    The target, `target_um` wide, covers `target_px` of the image's `picture_px` from `distance_um` away. The thesis
    omits the 1/2 here as well. Raises ValueError unless all are finite and positive.
    """
    _check_positive(target_um=target_um, target_px=target_px, picture_px=picture_px, distance_um=distance_um)
    return view_angle_deg(target_um * picture_px / target_px, distance_um)


def focal_px(picture_px: float, view_deg: float) -> float:
    """Return the focal length in px from the image's size along one axis and the full angle of view along the *same*.

    Eq. 3.26 and 3.27 as they are meant. As printed, they have the two angles swapped: 5026 is 2000 / tan(43.4 / 2) and
    2806 is 1500 / tan(56.26 / 2), width with the vertical angle and height with the horizontal one. Put right, they
    give f_x = 3741 and f_y = 3769, equal within 1 %, as square pixels must.
    Raises ValueError unless `picture_px` is positive and `view_deg` lies between 0 and 180.
    """
    _check_positive(picture_px=picture_px, view_deg=view_deg)
    if view_deg >= 180.0:
        raise ValueError(f"view_deg must be less than 180, got {view_deg!r}")
    return picture_px / 2.0 / math.tan(math.radians(view_deg) / 2.0)


@dataclass(frozen=True)
class Intrinsics:
    """The camera by itself (eq. 3.6): focal lengths and principal point, px. Raises ValueError if no camera has them.

    Pixel centres lie at integers, so the middle of an image W wide is (W - 1) / 2; the thesis' example takes W / 2.
    """

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float

    def __post_init__(self) -> None:
        _check_numbers(self)
        _check_positive(fx_px=self.fx_px, fy_px=self.fy_px)

    @property
    def matrix(self) -> Array:
        """Return K, shape (3, 3)."""
        return np.array([[self.fx_px, 0.0, self.cx_px], [0.0, self.fy_px, self.cy_px], [0.0, 0.0, 1.0]])

    @classmethod
    def from_sensor(cls, focal_mm: float, pixel_um: tuple[float, float], size_px: tuple[int, int]) -> Intrinsics:
        """Return the camera of a lens and a sensor: f / s_x, f / s_y of eq. 3.6; size is (width, height)."""
        _check_positive(
            focal_mm=focal_mm, pixel_x_um=pixel_um[0], pixel_y_um=pixel_um[1], width_px=size_px[0], height_px=size_px[1]
        )
        f_um = focal_mm * 1000.0
        return cls(f_um / pixel_um[0], f_um / pixel_um[1], (size_px[0] - 1) / 2.0, (size_px[1] - 1) / 2.0)

    @classmethod
    def from_view(cls, size_px: tuple[int, int], view_deg: tuple[float, float]) -> Intrinsics:
        """Return the camera of two full angles of view (horizontal, vertical): eq. 3.26 and 3.27 put right, centred."""
        (width, height), (horizontal, vertical) = size_px, view_deg
        return cls(focal_px(width, horizontal), focal_px(height, vertical), (width - 1) / 2.0, (height - 1) / 2.0)


@dataclass(frozen=True)
class Extrinsics:
    """Where the world is in the camera's frame (eq. 3.8, 3.9): `P_camera = R P_world + t`.

    `R = R_z R_y R_x` (eq. 3.11 to 3.14): turn about x first, then y, then z, all axes the camera's, right-handed. The
    thesis writes radians, this class degrees. Raises ValueError if a number is not finite.

    At theta_y = +-90 deg only theta_x -+ theta_z is determined; R itself is sound there.
    """

    theta_x_deg: float
    theta_y_deg: float
    theta_z_deg: float
    tx_um: float
    ty_um: float
    tz_um: float

    def __post_init__(self) -> None:
        _check_numbers(self)

    @property
    def rotation(self) -> Array:
        """Return R, shape (3, 3).

        Eq. A.8 prints cos for the sine in the last row of R_x; eq. 3.12 and A.7 have it right.
        """
        rx, ry, rz = np.eye(3), np.eye(3), np.eye(3)
        rx[1:, 1:] = rotation(self.theta_x_deg)
        ry[np.ix_([0, 2], [0, 2])] = rotation(-self.theta_y_deg)
        rz[:2, :2] = rotation(self.theta_z_deg)
        return np.asarray(rz @ ry @ rx)

    @property
    def translation_um(self) -> Array:
        """Return t, shape (3,), um."""
        return np.array([self.tx_um, self.ty_um, self.tz_um])

    @property
    def matrix(self) -> Array:
        """Return M_ext = (R t), shape (3, 4) (eq. 3.9)."""
        return np.column_stack([self.rotation, self.translation_um])

    @property
    def centre_um(self) -> Array:
        """Return the camera's centre of projection in the world, shape (3,), um: the inverse of eq. 3.22."""
        return np.asarray(-self.rotation.T @ self.translation_um)

    @classmethod
    def from_matrix(cls, r: Array, t_um: ArrayLike) -> Extrinsics:
        """Return the angles and the translation of a rotation matrix (3, 3) and a vector (3,).

        theta_y comes out within +-90 deg. z is taken first and the rest from R_z^T R, which loses no digits near
        theta_y = +-90 deg. Raises ValueError if `r` is no rotation (off by more than 1e-6).
        """
        r, t = check_points(r, "r", 3), check_points(t_um, "t_um", 3)
        if r.shape != (3, 3) or t.shape != (3,):
            raise ValueError(f"a rotation is (3, 3) and a translation (3,), got {r.shape} and {t.shape}")
        if np.abs(r @ r.T - np.eye(3)).max() > 1e-6 or np.linalg.det(r) < 0.0:
            raise ValueError("r is no rotation: its rows are not orthonormal and right-handed")
        z_deg = math.degrees(math.atan2(r[1, 0], r[0, 0]))
        rest = r.copy()
        rest[:2] = rotation(z_deg).T @ r[:2]
        y_deg = math.degrees(math.atan2(-rest[2, 0], rest[0, 0]))
        x_deg = math.degrees(math.atan2(-rest[1, 2], rest[1, 1]))
        return cls(
            theta_x_deg=x_deg,
            theta_y_deg=y_deg,
            theta_z_deg=z_deg,
            tx_um=float(t[0]),
            ty_um=float(t[1]),
            tz_um=float(t[2]),
        )

    def to_camera_um(self, points_um: ArrayLike) -> Array:
        """Return world points, (3,) or (N, 3), in the camera's frame, um; the last column is the depth (eq. 3.8)."""
        return np.asarray(check_points(points_um, "points_um", 3) @ self.rotation.T + self.translation_um)


def project(points_um: ArrayLike, intrinsics: Intrinsics, extrinsics: Extrinsics) -> Array:
    """Return the pixels, (2,) or (N, 2), of world points, (3,) or (N, 3), um (eq. 3.10, 3.24).

    Pixels may lie outside the image. Raises ValueError if a point is not in front of the camera.

    The worked example (eq. 3.28 to 3.30) does not use the K it prints: its second row needs f_y = 5026, not 2806. With
    f_x = f_y = 5026 all of eq. 3.30 follows within the rounding of M_ext. Its first pixel is (1351, 753), not 1360.
    """
    with np.errstate(all="ignore"):
        seen = extrinsics.to_camera_um(points_um)
        depth = seen[..., 2:]
        pixels = seen[..., :2] / depth * (intrinsics.fx_px, intrinsics.fy_px) + (intrinsics.cx_px, intrinsics.cy_px)
    if not (depth > 0.0).all():
        raise ValueError(
            "a point lies behind the camera or beside it; check the pose and which way the world's z points"
        )
    if not np.isfinite(pixels).all():
        raise ValueError("a point is too far to the side to have a pixel")
    return np.asarray(pixels)


@dataclass(frozen=True)
class Ray:
    """Lines of sight in the world: `origin_um` (3,), unit vectors `direction` (3,) or (N, 3) away from the camera."""

    origin_um: Array
    direction: Array


@dataclass(frozen=True)
class Plane:
    """The world points with `normal . P = offset_um`; the normal is made a unit vector. ValueError if it has no length.

    The default is z = 0: the board's surface, when the world's origin lies on it.
    """

    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    offset_um: float = 0.0

    def __post_init__(self) -> None:
        normal = check_points(self.normal, "normal", 3)
        length = math.hypot(*normal) if normal.ndim == 1 else 0.0
        if not (math.isfinite(length) and length > 1e-100 and math.isfinite(self.offset_um)):
            raise ValueError(f"a plane needs a normal (x, y, z) and an offset, got {self.normal}, {self.offset_um}")
        x, y, z = (float(v) for v in normal / length)
        object.__setattr__(self, "normal", (x, y, z))


def pixel_ray(points_px: ArrayLike, intrinsics: Intrinsics, extrinsics: Extrinsics) -> Ray:
    """Return the rays of pixels, (2,) or (N, 2): eq. 3.10 read backwards, known up to the depth."""
    pixels = check_points(points_px, "points_px", 2)
    with np.errstate(over="ignore"):
        flat = (pixels - (intrinsics.cx_px, intrinsics.cy_px)) / (intrinsics.fx_px, intrinsics.fy_px)
        length = np.hypot(np.hypot(flat[..., :1], flat[..., 1:]), 1.0)
    if not np.isfinite(length).all():
        raise ValueError("points_px are too far out to have a direction")
    toward = np.concatenate([flat / length, 1.0 / length], axis=-1)
    return Ray(extrinsics.centre_um, toward @ extrinsics.rotation)


def intersect(ray: Ray, plane: Plane) -> Array:
    """Return where rays meet a plane, (3,) or (N, 3), um.

    Raises ValueError if a ray runs along the plane or meets it behind the camera only.
    """
    normal = np.array(plane.normal)
    with np.errstate(all="ignore"):
        slope = ray.direction @ normal
        way_um = (plane.offset_um - ray.origin_um @ normal) / slope
        met = ray.origin_um + way_um[..., None] * ray.direction
    if not ((np.abs(slope) > LEAST_SLOPE) & (way_um > 0.0)).all():
        raise ValueError("a line of sight does not meet the plane before the camera; is the pixel beyond its horizon?")
    if not np.isfinite(met).all():
        raise ValueError("a line of sight meets the plane too far away")
    return np.asarray(met)


def back_project(
    points_px: ArrayLike, intrinsics: Intrinsics, extrinsics: Extrinsics, plane: Plane | None = None
) -> Array:
    """Return the world points, (3,) or (N, 3), um, that pixels show on a plane (default z = 0).

    The inverse of `project` for points of that plane. Errors as `pixel_ray` and `intersect`.
    """
    return intersect(pixel_ray(points_px, intrinsics, extrinsics), plane or Plane())
