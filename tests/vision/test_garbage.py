"""Whatever comes in: an answer that says nothing was found, a plausible one, or a ValueError.

Never another exception, never a warning, never a NaN, and never a changed input.
Where nothing is drawn, nothing is found.
"""

import io
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from tests.vision.scene import NOMINAL_TIP
from vision import (
    Extrinsics,
    Intrinsics,
    NotFound,
    ProbeModel,
    Reason,
    Seen,
    crop,
    draw_test_points,
    draw_tip,
    find_control_point,
    find_test_points,
    find_tip,
    fit_extrinsics,
    make_orthophoto,
    measure_quality,
    project,
)
from vision.annotate.draw import draw_control_point, draw_untaught

SIDE = 800
CALM = settings(
    deadline=None,
    derandomize=True,
    # A failing picture is told by its few numbers; making it smaller takes minutes and says no more.
    phases=(Phase.explicit, Phase.generate),
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow, HealthCheck.data_too_large],
)
CAMERA = Intrinsics.from_view((SIDE, SIDE), (20.0, 20.0))
POSE = Extrinsics(150.0, 5.0, 30.0, 100.0, -200.0, 50_000.0)
NONE = NotFound(Reason.NO_NEEDLE, "nothing was looked for")
ANY_FLOAT = st.floats() | st.floats(-1e4, 1e4) | st.floats(0, SIDE)
POINTS = st.tuples(ANY_FLOAT, ANY_FLOAT)
IN_FRAME = st.tuples(st.floats(0, SIDE), st.floats(0, SIDE)) | st.just(NOMINAL_TIP)
Frame = np.ndarray


@dataclass(frozen=True)
class Pattern:
    """A picture without needle, pad or mark, in a few numbers."""

    kind: str
    seed: int
    low: int
    high: int
    turn_deg: int
    period_px: int
    noise: float
    tint: tuple[float, float, float]

    def drawn(self) -> Frame:
        rng, turn, period = np.random.default_rng(self.seed), np.radians(self.turn_deg), self.period_px
        y, x = np.mgrid[:SIDE, :SIDE].astype(np.float32)
        along, across = x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn)
        share = {
            "uniform": lambda: np.zeros((SIDE, SIDE)),
            "noise": lambda: rng.random((SIDE, SIDE)),
            "checks": lambda: (np.floor(along / period) + np.floor(across / period)) % 2,
            "stripes": lambda: np.floor(along / period) % 2,
            "waves": lambda: 0.5 + 0.5 * np.sin(along * (2 * np.pi / period)),
            "gradient": lambda: (along - along.min()) / np.ptp(along),
        }[self.kind]()
        level = self.low + (self.high - self.low) * share + rng.normal(0.0, self.noise, (SIDE, SIDE))
        return np.clip(np.rint(level[..., None] * np.array(self.tint)), 0, 255).astype(np.uint8)


PATTERNS = st.builds(
    Pattern,
    st.sampled_from(["uniform", "noise", "checks", "stripes", "waves", "gradient"]),
    st.integers(0, 2**32 - 1),
    st.integers(0, 255),
    st.integers(0, 255),
    st.integers(0, 179),
    st.sampled_from([2, 5, 9, 16, 31, 64, 150]),
    st.sampled_from([0.0, 2.0, 8.0]),
    st.sampled_from([(1.0, 1.0, 1.0), (0.1, 0.15, 1.0), (1.0, 0.2, 0.2)]),
)


@dataclass(frozen=True)
class Clutter:
    """Blobs, bars and blocks thrown about the tip, broken as a torn JPEG is: anything may be seen in it."""

    seed: int
    things: int
    blurred: bool
    broken: int
    noise: float

    def drawn(self) -> Frame:
        rng = np.random.default_rng(self.seed)
        frame = np.full((SIDE, SIDE, 3), rng.integers(0, 256), np.uint8)
        for _ in range(self.things):
            self._thing(frame, rng)
        if self.blurred:
            frame = cv2.GaussianBlur(frame, (0, 0), float(rng.uniform(0.5, 3.0))).astype(np.uint8)
        for row, column, to in rng.integers(SIDE // 8, size=(self.broken, 3)) * 8:
            frame[row : row + 8, column : column + 8] = frame[to : to + 8, column : column + 8].copy()
        return np.clip(frame + rng.normal(0, self.noise, frame.shape), 0, 255).astype(np.uint8)

    @staticmethod
    def _thing(frame: Frame, rng: np.random.Generator) -> None:
        x, y = (int(v) for v in rng.normal(NOMINAL_TIP, 60.0))
        level, shape = (int(rng.integers(0, 256)),) * 3, rng.integers(3)
        if shape == 0:
            axes = int(rng.integers(1, 50)), int(rng.integers(1, 50))
            cv2.ellipse(frame, (x, y), axes, 30.0, 0.0, 360.0, level, -1)
        elif shape == 1:
            to_x, to_y = (int(v) for v in rng.normal(NOMINAL_TIP, 120.0))
            cv2.line(frame, (x, y), (to_x, to_y), level, int(rng.integers(1, 20)), cv2.LINE_AA)
        else:
            cv2.rectangle(frame, (x, y), (x + int(rng.integers(1, 90)), y + int(rng.integers(1, 90))), level, -1)


CLUTTER = st.builds(
    Clutter,
    st.integers(0, 2**32 - 1),
    st.integers(0, 40),
    st.booleans(),
    st.sampled_from([0, 100, 3000]),
    st.sampled_from([0.0, 3.0, 8.0]),
)


def _numbers(thing: Any) -> list[float]:
    """Return every number anywhere in a result, masks and outlines included."""
    if is_dataclass(thing):
        return [number for field in fields(thing) for number in _numbers(getattr(thing, field.name))]
    if isinstance(thing, tuple | list):
        return [number for part in thing for number in _numbers(part)]
    if isinstance(thing, np.ndarray):
        return [float(v) for v in thing.ravel()[:50]]
    return [float(thing)] if isinstance(thing, float | int | np.number) else []


def _is_plausible(found: Any, shape: tuple[int, ...]) -> bool:
    """Tell whether a tip, a pad or a mark lies in its picture, all its numbers finite and its sigma too."""
    inside = -0.5 <= found.x_px <= shape[1] - 0.5 and -0.5 <= found.y_px <= shape[0] - 0.5
    return inside and bool(np.isfinite(_numbers(found)).all()) and 0.0 < found.sigma_px < 10.0


def _check(found: Any, shape: tuple[int, ...]) -> None:
    if isinstance(found, Seen):
        assert np.isfinite([number for one in (found.thrown, found.undecided) for number in _numbers(one)]).all()
        for point in found.taken:
            assert _is_plausible(point, shape)
        found = found.nearest
    if isinstance(found, NotFound):
        assert found.message
        assert "nan" not in found.message
    else:
        assert _is_plausible(found, shape)


def _gives(call: Callable[[], Any]) -> Any:
    """Return what a call gives, None where it refuses its input; any other exception or warning fails the test."""
    try:
        return call()
    except ValueError as exc:
        message = str(exc)
    assert len(message) > 10
    return None


@settings(CALM, max_examples=60)
@given(pattern=PATTERNS)
def test_where_nothing_is_drawn_there_is_no_tip_and_no_mark(model: ProbeModel, pattern: Pattern) -> None:
    frame = pattern.drawn()
    before = frame.copy()
    assert isinstance(find_tip(frame, model), NotFound)
    assert isinstance(find_control_point(frame, NOMINAL_TIP), NotFound)
    assert np.array_equal(frame, before)


@settings(CALM, max_examples=60)
@given(pattern=PATTERNS, radius=st.sampled_from([None, 6.0, 18.0, 42.0]))
def test_where_nothing_is_drawn_there_is_no_pad(pattern: Pattern, radius: float | None) -> None:
    frame = pattern.drawn()
    before = frame.copy()
    seen = find_test_points(frame, NOMINAL_TIP, 30, radius)
    _check(seen, frame.shape)
    # Noise at full scale, and squares, are full of specks of a via's size.
    specks = pattern.kind in {"noise", "checks"}
    assert not [point for point in seen.taken if point.radius_px > 12 or not specks]
    assert np.array_equal(frame, before)


@settings(CALM, max_examples=30)
@given(clutter=CLUTTER, radius=st.none() | st.floats(2, 60), reach=st.floats(5, 90), around=IN_FRAME)
def test_clutter_gives_nothing_or_something_plausible(
    model: ProbeModel, clutter: Clutter, radius: float | None, reach: float, around: tuple[float, float]
) -> None:
    frame = clutter.drawn()
    before = frame.copy()
    for found in (
        find_tip(frame, model),
        _gives(lambda: find_test_points(frame, around, reach, radius)),
        find_control_point(frame, around, reach, 55.0),
    ):
        if found is not None:
            _check(found, frame.shape)
    assert np.isfinite([v for v in _numbers(measure_quality(frame)) if v != np.inf]).all()
    assert np.array_equal(frame, before)


@settings(CALM, max_examples=10)
@given(clutter=CLUTTER)
def test_how_a_picture_lies_in_memory_changes_nothing(model: ProbeModel, clutter: Clutter) -> None:
    frame = clutter.drawn()
    wide = np.zeros((SIDE, 2 * SIDE, 3), np.uint8)
    wide[:, ::2] = frame
    locked = frame.copy()
    locked.flags.writeable = False
    views = (
        wide[:, ::2],
        np.asfortranarray(frame),
        frame[::-1].copy()[::-1],
        frame[..., ::-1].copy()[..., ::-1],
        locked,
    )
    finders: tuple[Callable[[Frame], Any], ...] = (
        lambda picture: find_tip(picture, model),
        lambda picture: find_test_points(picture, NOMINAL_TIP).nearest,
        lambda picture: find_control_point(picture, NOMINAL_TIP),
        measure_quality,
        lambda picture: make_orthophoto(picture, CAMERA, POSE, (0.0, 0.0, 900.0, 900.0), 0.05).picture.tolist(),
        lambda picture: crop(picture, (-5, -5, 40, 40)).tolist(),
    )
    for find in finders:
        first = find(frame)
        for view in views:
            assert repr(find(view)) == repr(first)


ODD_ARRAYS = arrays(
    st.sampled_from([np.uint8, np.uint16, np.float32, np.float64, np.int16, np.bool_, np.complex64]),
    array_shapes(min_dims=1, max_dims=4, min_side=0, max_side=12),
) | st.sampled_from(
    [None, 3, "frame.png", [[1, 2], [3, 4]], np.zeros((10, 10, 3), np.uint8), np.zeros((0, 5, 3), np.uint8)]
)
ODD_FRAMES = st.sampled_from(
    [
        np.zeros((SIDE, SIDE), np.uint8),
        np.zeros((SIDE, SIDE, 1), np.uint8),
        np.zeros((SIDE, SIDE, 4), np.uint8),
        np.zeros((SIDE, SIDE, 3), np.uint16),
        np.full((SIDE, SIDE, 3), np.nan, np.float32),
        np.zeros((1, 1600, 3), np.uint8),
        np.zeros((1600, 1, 3), np.uint8),
        np.full((SIDE, 3, 3), 255, np.uint8),
    ]
)


def _readers(model: ProbeModel, image: Any, at: Any) -> tuple[Callable[[], Any], ...]:
    """Return a call of everything that takes a picture."""
    return (
        lambda: find_tip(image, model),
        lambda: find_test_points(image, at),
        lambda: find_control_point(image, at),
        lambda: ProbeModel.teach(image, at),
        lambda: measure_quality(image),
        lambda: make_orthophoto(image, CAMERA, POSE, (0.0, 0.0, 900.0, 900.0), 0.05),
        lambda: draw_tip(image, NONE, at),
        lambda: draw_untaught(image, at, "no reason"),
        lambda: draw_test_points(image, Seen(NONE, (), (), (), (0, 0, 10, 10)), at),
        lambda: draw_control_point(image, NONE, at),
    )


@settings(CALM, max_examples=60)
@given(image=ODD_ARRAYS | ODD_FRAMES, at=IN_FRAME)
def test_what_is_no_picture_is_refused_and_what_is_too_small_holds_nothing(
    model: ProbeModel, image: Any, at: tuple[float, float]
) -> None:
    is_picture = isinstance(image, np.ndarray) and image.dtype == np.uint8 and image.ndim == 3 and image.shape[2] == 3
    for call in _readers(model, image, at):
        result = _gives(call)
        if not is_picture or 0 in image.shape:
            assert result is None
        elif isinstance(result, Seen):
            assert isinstance(result.nearest, NotFound)
            assert not result.taken


@pytest.fixture(scope="module")
def busy() -> Frame:
    rng = np.random.default_rng(3)
    frame = np.full((SIDE, SIDE, 3), 60, np.uint8)
    cv2.circle(frame, (428, 620), 17, (20, 30, 200), -1, cv2.LINE_AA)
    return np.clip(frame + rng.normal(0, 3, frame.shape), 0, 255).astype(np.uint8)


@settings(CALM, max_examples=150)
@given(at=POINTS, reach=ANY_FLOAT, radius=st.none() | ANY_FLOAT, arm=ANY_FLOAT)
def test_numbers_of_any_kind(
    busy: Frame, at: tuple[float, float], reach: float, radius: float | None, arm: float
) -> None:
    before = busy.copy()
    for call in (
        lambda: find_test_points(busy, at, reach, radius),
        lambda: find_test_points(busy, NOMINAL_TIP, min(reach, 40.0), radius),
        lambda: find_control_point(busy, at, reach, arm),
        lambda: find_control_point(busy, NOMINAL_TIP, reach, min(arm, 60.0)),
        lambda: ProbeModel.teach(busy, at, arm),
    ):
        found = _gives(call)
        if found is not None:
            _check(found, busy.shape)
    for numbers in (at, (at[0], np.nan), (np.inf, at[1])):
        if not np.isfinite(numbers).all():
            for refusing in (find_test_points, find_control_point, ProbeModel.teach):
                with pytest.raises(ValueError, match="finite"):
                    refusing(busy, numbers)
    assert np.array_equal(busy, before)


AREAS = st.tuples(*[st.integers(-100, 2 * SIDE)] * 4) | st.tuples(*[ANY_FLOAT] * 4)


@settings(CALM, max_examples=80)
@given(area=AREAS, scale=ANY_FLOAT | st.floats(0.001, 0.1), z=ANY_FLOAT)
def test_areas_of_any_kind(busy: Frame, area: tuple[Any, Any, Any, Any], scale: float, z: float) -> None:
    quality = _gives(lambda: measure_quality(busy, area))
    assert quality is None or not np.isnan(_numbers(quality)).any()
    flat = _gives(lambda: make_orthophoto(busy, CAMERA, POSE, area, scale, z))
    assert flat is None or (flat.picture.dtype == np.uint8 and flat.picture.size > 0)


@settings(CALM, max_examples=120)
@given(
    points=arrays(np.float64, array_shapes(min_dims=1, max_dims=3, min_side=0, max_side=7), elements=ANY_FLOAT)
    | arrays(np.float64, (6, 3), elements=st.floats(-2000, 2000)),
    pixels=arrays(np.float64, array_shapes(min_dims=1, max_dims=3, min_side=0, max_side=7), elements=ANY_FLOAT)
    | arrays(np.float64, (6, 2), elements=st.floats(0, SIDE)),
    sigma=st.none() | ANY_FLOAT,
)
def test_points_of_any_kind_are_projected_or_refused(points: Frame, pixels: Frame, sigma: float | None) -> None:
    before = points.copy(), pixels.copy()
    seen = _gives(lambda: project(points, CAMERA, POSE))
    assert seen is None or np.isfinite(seen).all()
    fit = _gives(lambda: fit_extrinsics(points, pixels, CAMERA, sigma_px=sigma))
    if fit is not None:
        assert np.isfinite(_numbers(fit.extrinsics)).all()
        assert np.isfinite(fit.rms_px)
    assert np.array_equal(points, before[0], equal_nan=True)
    assert np.array_equal(pixels, before[1], equal_nan=True)


@pytest.fixture(scope="module")
def taught(model: ProbeModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("taught") / "probe.npz"
    model.save(path)
    return path


@settings(CALM, max_examples=60)
@given(junk=st.binary(max_size=200), at=st.floats(0, 0.99), whole=st.booleans())
def test_a_broken_probe_model_is_refused_as_such(
    taught: Path, tmp_path: Path, junk: bytes, at: float, whole: bool
) -> None:
    stored = taught.read_bytes()
    broken = junk if whole else stored[: int(at * len(stored))] + junk
    path = tmp_path / "probe.npz"
    path.write_bytes(broken)
    with pytest.raises(ValueError, match="teach the needle again"):
        ProbeModel.load(path)


def test_a_foreign_npz_is_no_probe_model(tmp_path: Path) -> None:
    file = io.BytesIO()
    np.savez(file, facts=np.array("{}"), golden=np.zeros((3, 3)))
    path = tmp_path / "probe.npz"
    path.write_bytes(file.getvalue())
    with pytest.raises(ValueError, match="not a probe model"):
        ProbeModel.load(path)


@settings(CALM, max_examples=25)
@given(at=POINTS, reach=ANY_FLOAT)
def test_whatever_is_asked_to_be_drawn_is_drawn_or_refused(
    model: ProbeModel, busy: Frame, at: tuple[float, float], reach: float
) -> None:
    before = busy.copy()
    seen = find_test_points(busy, NOMINAL_TIP)
    for call in (
        lambda: draw_tip(busy, NONE, at),
        lambda: draw_tip(busy, find_tip(busy, model), at, taught=model),
        lambda: draw_untaught(busy, at, "no reason"),
        lambda: draw_test_points(busy, seen, at),
        lambda: draw_control_point(busy, NONE, at, reach, 40.0),
    ):
        page = _gives(call)
        assert page is None or (page.dtype == np.uint8 and page.ndim == 3 and page.size > 0)
    assert np.array_equal(busy, before)
