"""Scene before the lens: what lies on the bench, the probe in front of it, shadow and glint.

What is NOT modelled: the thickness of the card, shadows of parts, reflections of the probe in the solder mask, lens
distortion.
"""

import math
from dataclasses import dataclass
from typing import Any, Protocol

import cv2
import numpy as np
import numpy.typing as npt

from sim_hw.board.board import ROBOT_ORIGIN_UM, Board
from sim_hw.board.nest import InNest
from sim_hw.plant.card import CardPose
from sim_hw.scene.body import cut_out
from sim_hw.scene.glint import highlight
from sim_hw.scene.ground import Ground
from sim_hw.scene.needle import Needle, NeedleImage
from sim_hw.scene.needle_shadow import shadow
from sim_hw.scene.optics import HEIGHT_PX, WIDTH_PX, Head, Pose, Stand, make_optics
from sim_hw.scene.sensor import AMBIENT, NOMINAL_EXPOSURE_S, Exposed, Sensor, SensorSettings
from sim_hw.scene.texture import BENCH_RED, BENCH_WHITE, Image

_LIGHT_SAMPLES = 9
_MOVING_VIEWS = 4
_FAINT_GREY = 1.2
"""Light that would not lift a white thing by this much is left out."""
_FLEX_LIMIT_PX = 2.0
_PADS_REACH_UM = 6_000.0
_GAP_STEP_UM = 25.0
_WHITE_LAMP = (38.0, 0.75)
"""Where the shadows fall (degrees from the camera's viewing direction) and how long they are."""
_RED_LAMP = (-46.0, 0.70)


class ScenePlant(Protocol):
    """What the image needs of the plant."""

    @property
    def board_pose(self) -> Pose: ...  # noqa: D102  # the names say it
    @property
    def card_pose(self) -> CardPose: ...  # noqa: D102
    @property
    def knobs(self) -> Any: ...  # noqa: D102
    def state_at(self, t_s: float) -> Head: ...  # noqa: D102
    def rest_s(self) -> float: ...  # noqa: D102


class SceneFaults(Protocol):
    """What is broken."""

    def on(self, name: str) -> bool: ...  # noqa: D102
    def get(self, name: str) -> Any: ...  # noqa: D102


@dataclass(frozen=True)
class Shot:
    """One exposure to be drawn: what was true while it lasted (`states`, evenly spread) and how it was taken.

    `focus_px` is blur added by a lens out of focus.
    """

    sequence: int
    exposure_s: float
    states: tuple[Head, ...]
    gain: float = 1.0
    balance: tuple[float, float, float] = (1.0, 1.0, 1.0)
    focus_px: float = 0.0


def watch(plant: ScenePlant, start_s: float, exposure_s: float) -> tuple[Head, ...]:
    """Return what is true at times spread evenly over an exposure (simulated seconds)."""
    step_s = exposure_s / _LIGHT_SAMPLES
    return tuple(plant.state_at(start_s + (i + 0.5) * step_s) for i in range(_LIGHT_SAMPLES))


class Scene:
    """Draw frames of one board side under one camera. Not to be used by two threads at once.

    `tiles` is how many tiles of the board's texture are kept; None: as many as make a station of some 300 MB.
    """

    def __init__(
        self, plant: ScenePlant, board: Board, faults: SceneFaults, seed: int, tiles: int | None = None
    ) -> None:
        self._plant = plant
        self._nest = InNest.made(board)
        self._faults = faults
        self._seed = seed
        self.optics = make_optics()
        self.needle = Needle(self.optics, seed)
        self._ground = Ground(self.optics, self._nest, seed, tiles)
        self._sensor = Sensor(seed)
        self._ready = False
        self._needle_key: tuple[float, float, float, float] | None = None
        self._needle_image: NeedleImage | None = None
        self._shadows: dict[tuple[str, int, int], npt.NDArray[np.float32]] = {}

    @property
    def _board(self) -> Board:
        return self._nest.board

    def put(self, nest: InNest) -> None:
        """Show what lies in the nest now, from the next frame on; may be called from another thread."""
        self._nest = nest

    @property
    def lying(self) -> tuple[int, int]:
        """Return numbers that stay the same as long as what lies in the nest looks the same: which it is, its marks."""
        return self._nest.number, len(self._nest.marks)

    def render(self, shot: Shot) -> Image:
        """Return the frame (1200, 1600, 3) BGR uint8 of an exposure; the same shot gives the same frame."""
        self._ground.put(self._nest)
        rng = np.random.default_rng((self._seed, shot.sequence, 7))
        return self._sensor.read(self._expose(shot, rng), self._settings(shot), rng)

    def _settings(self, shot: Shot) -> SensorSettings:
        knobs = self._plant.knobs
        return SensorSettings(
            exposure_s=shot.exposure_s,
            gain=shot.gain,
            balance=shot.balance,
            blur_px=math.hypot(knobs.camera_blur_px, shot.focus_px),
            noise_grey=knobs.camera_noise_grey * math.sqrt(max(shot.gain, 0.25)),
            falloff=knobs.camera_falloff,
        )

    def draw_ahead(self, goal: Head | None = None) -> bool:
        """Do a little of what later frames will need; return False once all of it is done.

        `goal` is where the head will come to rest: what is seen from there comes first.
        """
        self._ground.put(self._nest)
        if not self._ready:
            self._sensor.prepare(self._settings(Shot(0, NOMINAL_EXPOSURE_S, ())))
            self._ready = True
        if goal is None:
            return self._ground.draw_ahead()
        return self._ground.draw_ahead(self._stand(goal), self._plant.board_pose)

    def tip_px(self, state: Head) -> tuple[float, float]:
        """Return where the end of the probe is in the image, spring, bend and flex of the mount included."""
        straight = self.needle.end_px(state.pressed_um) + self._flex_px(state)
        x_px, y_px = straight + self._bent_px() * self.needle.bend_direction
        return (float(x_px), float(y_px))

    def _bent_px(self) -> float:
        return float(self._faults.get("bent")["px"]) if self._faults.on("bent") else 0.0

    def board_px(self, state: Head, x_mm: float, y_mm: float) -> tuple[float, float]:
        """Return where a CAD point (mm) of the board as it really lies is in the image."""
        u_um, v_um = self._board.nominal_um(x_mm, y_mm)
        place = np.array([(u_um - ROBOT_ORIGIN_UM[0]) / 1e3, (v_um - ROBOT_ORIGIN_UM[1]) / 1e3, 1.0])
        x, y, w = self._ground.board_to_px(self._stand(state), self._plant.board_pose) @ place
        return (float(x / w), float(y / w))

    def card_px(self, state: Head) -> tuple[float, float]:
        """Return where the control point of the card as it really lies is in the image, be it hidden or not."""
        x, y, w = self._ground.card_to_px(self._stand(state), self._plant.card_pose)[:, 2]
        return (float(x / w), float(y / w))

    def _stand(self, state: Head) -> Stand:
        tip_um = (state.tip_x_um, state.tip_y_um, state.tip_z_um)
        return Stand(tip_um, state.theta_deg, self._flex_px(state))

    def _flex_px(self, state: Head) -> tuple[float, float]:
        """Return how far the mount has given way at this stop; none is drawn on the way."""
        sigma_px = float(self._plant.knobs.camera_flex_px)
        if state.moving or sigma_px <= 0.0:
            return (0.0, 0.0)
        stop = (round(state.tip_x_um), round(state.tip_y_um), round(state.theta_deg * 100.0))
        rng = np.random.default_rng((self._seed, *(abs(part) for part in stop)))
        x, y = np.clip(rng.normal(0.0, sigma_px, 2), -_FLEX_LIMIT_PX, _FLEX_LIMIT_PX)
        return (float(x), float(y))

    def _expose(self, shot: Shot, rng: np.random.Generator) -> Exposed:
        states = shot.states
        white_level = sum(state.white for state in states) / len(states)
        red_level = sum(state.red for state in states) / len(states)
        strength = shot.exposure_s / NOMINAL_EXPOSURE_S * shot.gain * 255.0
        views = [states[len(states) // 2]]
        if any(state.moving for state in states):
            chosen = np.linspace(0, len(states) - 1, _MOVING_VIEWS).round().astype(int)
            views = [states[k] for k in chosen]
        self._prepare_needle(views[-1])
        white = red = None
        if (white_level + AMBIENT) * strength > _FAINT_GREY:
            weights = [state.white + AMBIENT for state in views]
            white = self._image("white", views, weights)
        if red_level * strength > _FAINT_GREY:
            red = self._image("red", views, [state.red for state in views])
        self._add_glint([image for image in (white, red) if image is not None], views[-1], rng)
        return Exposed(white, white_level, red, red_level)

    def _image(self, light: str, views: list[Head], weights: list[float]) -> Image:
        if len(views) == 1:
            image = self._ground_image(light, views[0])
        else:
            total = sum(weights) or 1.0
            shape = (HEIGHT_PX, WIDTH_PX, 3) if light == "white" else (HEIGHT_PX, WIDTH_PX)
            mean = np.zeros(shape, dtype=np.float32)
            for state, weight in zip(views, weights, strict=True):
                cv2.scaleAdd(self._ground_image(light, state).astype(np.float32), weight / total, mean, dst=mean)
            image = np.round(mean).astype(np.uint8)
        self._lay_needle(light, image)
        return image

    def _ground_image(self, light: str, state: Head) -> Image:
        card = None if self._faults.on("card_gone") else self._plant.card_pose
        covered = self._faults.on("card_covered")
        both = self._ground.look(
            self._stand(state), self._plant.board_pose, card, covered=covered, gone=self._faults.on("board_gone")
        )
        if both is None:
            return self._bench(light)
        image = cv2.cvtColor(both, cv2.COLOR_BGRA2BGR) if light == "white" else cv2.extractChannel(both, 3)
        return self._shadowed(light, np.asarray(image, dtype=np.uint8), state)

    @staticmethod
    def _bench(light: str) -> Image:
        if light == "white":
            return np.full((HEIGHT_PX, WIDTH_PX, 3), BENCH_WHITE, dtype=np.uint8)
        return np.full((HEIGHT_PX, WIDTH_PX), BENCH_RED, dtype=np.uint8)

    def _shadowed(self, light: str, image: Image, state: Head) -> Image:
        if self._faults.on("missing"):
            return image
        step = round(min(max(state.tip_height_um, 0.0), 8_000.0) / _GAP_STEP_UM)
        pressed = round(state.pressed_um / _GAP_STEP_UM)
        key = (light, step, pressed)
        if key not in self._shadows:
            lamp = _WHITE_LAMP if light == "white" else _RED_LAMP
            if len(self._shadows) > 8:
                self._shadows.clear()
            size = (800, 760)
            self._shadows[key] = shadow(
                self.optics, self.needle, step * _GAP_STEP_UM, *lamp, size, pressed * _GAP_STEP_UM
            )
        left = self._shadows[key]
        region = image[: left.shape[0], : left.shape[1]]
        weights = left if image.ndim == 2 else cv2.merge([left, left, left])
        region[...] = cv2.multiply(region, weights, dtype=cv2.CV_8U)
        return image

    def _prepare_needle(self, state: Head) -> None:
        if self._faults.on("missing"):
            self._needle_key = self._needle_image = None
            return
        key = (*self._flex_px(state), self._bent_px(), float(round(state.pressed_um)))
        if key != self._needle_key:
            self._needle_image = self.needle.draw(key[:2], *key[2:])
            self._needle_key = key

    def _lay_needle(self, light: str, image: Image) -> None:
        needle = self._needle_image
        if needle is None:
            return
        height, width = needle.alpha.shape
        front = self._ground.front
        place = np.s_[needle.top : needle.top + height, needle.left : needle.left + width]
        region = image[place]
        before = None if front is None else region.copy()
        look = needle.white if light == "white" else needle.red
        fit = np.s_[: region.shape[0], : region.shape[1]]
        planes = 1 if image.ndim == 2 else 3
        alpha = np.asarray(cv2.merge([needle.alpha[fit]] * planes)).reshape(region.shape)
        shade = np.asarray(cv2.merge([look[fit]] * planes)).reshape(region.shape)
        region[...] = np.clip(region + (shade - region) * alpha, 0.0, 255.0)
        if front is not None and before is not None:
            cut_out(region, before, front[place])

    def _add_glint(self, images: list[Image], state: Head, rng: np.random.Generator) -> None:
        """Put a small highlight on the probe's cylinder or somewhere on the board, in some frames."""
        chance, place, spot_x, spot_y, size = rng.random(5)
        if self._faults.on("glint"):
            self._glint_on_pad(images, state, rng)
        if chance >= self._plant.knobs.camera_glint or not images:
            return
        if place < 0.6 and self._needle_image is not None:
            tip = np.array(self.tip_px(state))
            centre = tip + self.needle.up * (190.0 + 220.0 * spot_x) + self.needle.across * (24.0 * spot_y - 12.0)
        else:
            centre = np.array([spot_x * WIDTH_PX, spot_y * HEIGHT_PX])
        highlight(images, centre, 2.0 + 5.0 * size, 90.0)

    def _glint_on_pad(self, images: list[Image], state: Head, rng: np.random.Generator) -> None:
        """Blind the camera on the pad nearest to the tip, at another place of it in each frame."""
        places = np.array([self.board_px(state, pad.x_mm, pad.y_mm) for pad in self._pads_about(state)])
        if not len(places) or not images:
            return
        away = np.hypot(*(places - self.tip_px(state)).T)
        centre = places[int(np.argmin(away))] + rng.normal(0.0, 4.0, 2)
        highlight(images, centre, float(self._faults.get("glint")["px"]), 255.0)

    def _pads_about(self, state: Head) -> list[Any]:
        """Return the pads within a few millimetres of the tip, as if the board lay where it should or nearly so."""
        place = (state.tip_x_um, state.tip_y_um)
        nominal = [self._board.nominal_um(pad.x_mm, pad.y_mm) for pad in self._board.pads]
        return [pad for pad, at in zip(self._board.pads, nominal, strict=True) if math.dist(at, place) < _PADS_REACH_UM]
