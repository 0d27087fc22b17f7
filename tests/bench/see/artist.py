"""Frames of the simulated station's artist with everything known: where the board lies, what lies on it, what is off.

Board, needle, shadow and sensor are drawn by `sim_hw.scene`; how they are put together, and troubles, is told here.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from sim_hw.board.board import ROBOT_ORIGIN_UM, Board
from sim_hw.board.finish import Finish
from sim_hw.board.parts import Body
from sim_hw.board.shapes import Shape
from sim_hw.plant.pose import BoardPose
from sim_hw.scene.blemish import lay_dent
from sim_hw.scene.body import BodyArtist
from sim_hw.scene.needle import Needle
from sim_hw.scene.needle_shadow import shadow
from sim_hw.scene.optics import HEIGHT_PX, TIP_PX, WIDTH_PX, Stand, board_plane, make_optics
from sim_hw.scene.sensor import Exposed, Sensor, SensorSettings
from sim_hw.scene.texture import BENCH_RED, MARGIN_MM, TEXEL_UM, BoardTexture
from tests.bench.see import strewn

Frame = NDArray[np.uint8]
Matrix = NDArray[np.float64]
_RED_LAMP = (-46.0, 0.70)
_HEIGHT_UM = 400.0
_TOE_MM = 0.7
_DENTS_UM, _DENT_RADIUS_UM = 80.0, (20.0, 60.0)


@dataclass(frozen=True)
class Lie:
    """How the board really lies: displaced (um), turned by quarters about its middle, missing."""

    x_um: float = 0.0
    y_um: float = 0.0
    turn_deg: float = 0.0
    quarters: int = 0
    missing: bool = False


@dataclass(frozen=True)
class Trouble:
    """What is wrong with board, light and station. shifts in um; dirt: spots; tip_px: error of the assumed frame.

    unfitted: share of the parts that are missing from an assembled board; flux: blotches about soldered pads; label: a
    sticker somewhere in view; oxide: how tarnished bare metal is, 0..1; dents: so many of a needle's on the target.
    """

    ink: bool = True
    covered: bool = True
    ink_um: tuple[float, float] = (0.0, 0.0)
    openings_um: tuple[float, float] = (0.0, 0.0)
    dirt: int = 0
    parts: bool = False
    hasl: bool = False
    oxide: float = 0.0
    dents: int = 0
    unfitted: float = 0.0
    flux: int = 0
    label: bool = False
    noise_grey: float = 3.0
    blur_px: float = 1.0
    falloff: float = 0.15
    light: float = 1.0
    tip_px: float = 0.15
    scale: float = 0.0005
    needle: bool = True


@dataclass(frozen=True, eq=False)
class Shot:
    """A frame, the homography as the station assumes it and as it is (board um to px), and what the needle hides."""

    frame: Frame
    assumed: Matrix
    real: Matrix
    needle_px: NDArray[np.float64]

    def truth_px(self, x_um: float, y_um: float) -> tuple[float, float]:
        """Return where a place of the board really is in the picture."""
        x, y, w = self.real @ (x_um, y_um, 1.0)
        return float(x / w), float(y / w)


@dataclass(eq=False)
class Artist:
    """Draw frames of one side; keeps the texture for as long as the same trouble lies on it."""

    board: Board
    seed: int = 5
    bodies_um: tuple[NDArray[np.float64], ...] = ()
    _textures: dict[object, BoardTexture] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.optics = make_optics()
        self.needle = Needle(self.optics, self.seed)
        self.sensor = Sensor(self.seed)
        self._fitted = self.board
        self._standing = BodyArtist(self.optics, self.board) if self.board.bodies else None

    def shoot(self, at_um: tuple[float, float], lie: Lie, trouble: Trouble, rng: np.random.Generator) -> Shot:
        """Look with the tip above a place of the board as planned."""
        aside = rng.uniform(-60.0, 60.0, 2)
        tip = (ROBOT_ORIGIN_UM[0] + at_um[0] + aside[0], ROBOT_ORIGIN_UM[1] + at_um[1] + aside[1], _HEIGHT_UM)
        stand = Stand(tip, float(rng.uniform(-25.0, 25.0)))
        real = self._board_to_px(stand, lie)
        assumed = _misjudged(self._board_to_px(stand, Lie()), trouble, rng)
        plane = np.full((HEIGHT_PX, WIDTH_PX), BENCH_RED, dtype=np.uint8)
        front = None
        if not lie.missing:
            self._fit(trouble.unfitted)
            plane = self._ground(real, at_um, trouble, rng)
            plane, front = self._stand_parts(plane, stand, lie)
        bare = plane.copy() if front is not None else plane
        plane, outline = self._before(plane, trouble)
        if front is not None:
            plane = np.where(front > 0, bare, plane)
        settings = SensorSettings(exposure_s=0.02, gain=trouble.light, blur_px=trouble.blur_px,
                                  noise_grey=trouble.noise_grey, falloff=trouble.falloff)  # fmt: skip
        frame = self.sensor.read(Exposed(None, 0.0, plane, 1.0), settings, rng)
        return Shot(frame, assumed, real, outline)

    def _board_to_px(self, stand: Stand, lie: Lie) -> Matrix:
        """Return the map of the board's um, as seen from its side, to pixels."""
        pose = BoardPose(dx_um=lie.x_um, dy_um=lie.y_um, rotation_deg=lie.turn_deg + 90.0 * lie.quarters)
        plane = board_plane(ROBOT_ORIGIN_UM, self.board.size_mm, pose)
        return np.asarray(self.optics.homography(plane, stand) @ np.diag([1e-3, 1e-3, 1.0]))

    def _fit(self, unfitted: float) -> None:
        """Leave a share of the parts out, by the seed: the pads of each are bare then."""
        names = sorted({body.part for body in self.board.bodies})
        rng = np.random.default_rng([self.seed, 41])
        left_out = {name for name in names if rng.random() < unfitted}
        if left_out == {body.part for body in self.board.bodies} - {body.part for body in self._fitted.bodies}:
            return
        gone = [body for body in self.board.bodies if body.part in left_out]
        solder = tuple(s for s in self.board.layers.solder if not any(_belongs(s, body) for body in gone))
        bodies = tuple(body for body in self.board.bodies if body.part not in left_out)
        self._fitted = replace(self.board, bodies=bodies, layers=replace(self.board.layers, solder=solder))
        self._standing = BodyArtist(self.optics, self._fitted)
        self._textures.clear()

    def _stand_parts(self, plane: Frame, stand: Stand, lie: Lie) -> tuple[Frame, Frame | None]:
        """Draw the parts that the board carries; return where they hide the needle as well."""
        if self._standing is None:
            return plane, None
        pose = BoardPose(dx_um=lie.x_um, dy_um=lie.y_um, rotation_deg=lie.turn_deg + 90.0 * lie.quarters)
        image = np.repeat(plane[..., None], 4, axis=2)
        front = self._standing.draw(image, stand, pose)
        return np.ascontiguousarray(image[..., 3]), front

    def _ground(self, real: Matrix, at_um: tuple[float, float], trouble: Trouble, rng: np.random.Generator) -> Frame:
        texture = self._texture(trouble)
        to_mm = np.linalg.inv(texture.from_mm(self.board))
        to_px = real @ np.diag([1e3, 1e3, 1.0]) @ to_mm
        corners = np.array([[[0, 0], [WIDTH_PX, 0], [WIDTH_PX, HEIGHT_PX], [0, HEIGHT_PX]]], dtype=np.float64)
        seen = cv2.perspectiveTransform(corners, np.linalg.inv(to_px))[0]
        x0, y0 = np.maximum(np.floor(seen.min(axis=0)).astype(int) - 2, 0)
        x1, y1 = np.minimum(np.ceil(seen.max(axis=0)).astype(int) + 3, (texture.width, texture.height))
        if x1 - x0 < 4 or y1 - y0 < 4:
            return np.full((HEIGHT_PX, WIDTH_PX), BENCH_RED, dtype=np.uint8)
        texture.ensure(int(x0), int(y0), int(x1), int(y1))
        red = texture.image[y0:y1, x0:x1, 3].copy()
        self._strew(red, (int(x0), int(y0)), trouble, rng)
        for place in rng.normal(at_um, _DENTS_UM, (trouble.dents, 2)):
            x, y = self._to_texels(place[None])[0] - (x0, y0)
            lay_dent([red], (float(x), float(y)), float(rng.uniform(*_DENT_RADIUS_UM)) / TEXEL_UM)
        moved = np.array([[1.0, 0.0, x0], [0.0, 1.0, y0], [0.0, 0.0, 1.0]])
        warped = cv2.warpPerspective(red, to_px @ moved, (WIDTH_PX, HEIGHT_PX), flags=cv2.INTER_LINEAR,
                                     borderValue=float(BENCH_RED))  # fmt: skip
        return np.asarray(warped, dtype=np.uint8)

    def _strew(self, red: Frame, corner: tuple[int, int], trouble: Trouble, rng: np.random.Generator) -> None:
        """Lay parts and all sorts of dirt on the part of the texture that is looked at."""
        if trouble.parts:
            own = np.random.default_rng(self.seed)
            for body in self.bodies_um:
                grey = int(own.integers(10, 160))
                points = self._to_texels(body) - corner
                cv2.fillPoly(red, [np.round(points * 16).astype(np.int32)], grey, cv2.LINE_8, 4)
        if trouble.hasl:
            strewn.dome(red, rng)
        strewn.flux(red, trouble.flux, rng)
        if trouble.label:
            strewn.label(red, rng)
        strewn.dirt(red, trouble.dirt, rng)

    def _to_texels(self, points_um: NDArray[np.float64]) -> NDArray[np.float64]:
        columns = (points_um[:, 0] / 1e3 + MARGIN_MM) * 1e3 / TEXEL_UM - 0.5
        rows = (self.board.size_mm[1] + MARGIN_MM - points_um[:, 1] / 1e3) * 1e3 / TEXEL_UM - 0.5
        return np.column_stack((columns, rows))

    def _texture(self, trouble: Trouble) -> BoardTexture:
        key = (trouble.ink, trouble.covered, trouble.ink_um, trouble.openings_um, trouble.unfitted, trouble.oxide)
        if key not in self._textures:
            if len(self._textures) > 2:
                self._textures.clear()
            layers = self._fitted.layers
            # Shifts are told in the side's own frame; the bottom's x runs the other way in CAD.
            flip = 1.0 if self.board.side == "top" else -1.0
            layers = replace(
                layers,
                silk=_moved(layers.silk, trouble.ink_um, flip) if trouble.ink else (),
                mask=_moved(layers.mask, trouble.openings_um, flip),
            )
            self._textures[key] = BoardTexture(
                replace(self.board, layers=layers), self.seed, Finish(oxide=trouble.oxide)
            )
        return self._textures[key]

    def _before(self, plane: Frame, trouble: Trouble) -> tuple[Frame, NDArray[np.float64]]:
        """Lay shadow and needle over the board; return the needle's outline as well."""
        if not trouble.needle:
            return plane, np.empty((0, 2))
        left = shadow(self.optics, self.needle, _HEIGHT_UM, *_RED_LAMP, (800, 760))
        region = plane[: left.shape[0], : left.shape[1]]
        region[...] = cv2.multiply(region, left, dtype=cv2.CV_8U)
        image = self.needle.draw()
        height, width = image.alpha.shape
        region = plane[image.top : image.top + height, image.left : image.left + width]
        fit = np.s_[: region.shape[0], : region.shape[1]]
        region[...] = np.clip(region + (image.red[fit] - region) * image.alpha[fit], 0.0, 255.0)
        mask = np.zeros((HEIGHT_PX, WIDTH_PX), dtype=np.uint8)
        mask[image.top : image.top + region.shape[0], image.left : image.left + region.shape[1]] = (
            image.alpha[fit] > 0.05
        )
        contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        return plane, max(contours, key=cv2.contourArea)[:, 0, :].astype(np.float64)


def _belongs(solder: Shape, body: Body) -> bool:
    """Whether solder is on a pad of this body, within what pads reach beyond it."""
    x0, y0, x1, y1 = solder.box_mm
    return body.inside_mm((x0 + x1) / 2.0, (y0 + y1) / 2.0) > -_TOE_MM


def _moved(shapes: tuple[Shape, ...], shift_um: tuple[float, float], flip: float) -> tuple[Shape, ...]:
    dx, dy = flip * shift_um[0] / 1e3, shift_um[1] / 1e3
    if not dx and not dy:
        return shapes
    return tuple(
        Shape(
            s.outline_mm + np.array((dx, dy)),
            s.dark,
            (s.box_mm[0] + dx, s.box_mm[1] + dy, s.box_mm[2] + dx, s.box_mm[3] + dy),
        )
        for s in shapes
    )


def _misjudged(right: Matrix, trouble: Trouble, rng: np.random.Generator) -> Matrix:
    """Return the homography as a station knows it: the tip a little off, the map's scale a little wrong."""
    dx, dy = rng.normal(0.0, trouble.tip_px, 2)
    scale = 1.0 + rng.normal(0.0, trouble.scale)
    off = np.array([[scale, 0.0, TIP_PX[0] * (1 - scale) + dx], [0.0, scale, TIP_PX[1] * (1 - scale) + dy],
                    [0.0, 0.0, 1.0]])  # fmt: skip
    return np.asarray(off @ right)
