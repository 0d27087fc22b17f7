"""Whatever comes in: an answer that says nothing was found, or a ValueError. Never a crash, never a number."""

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from tests.vision.scene import NOMINAL_TIP
from vision import NotFound, ProbeModel, find_control_point, find_test_points, find_tip

CALM = settings(
    max_examples=25, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@st.composite
def noise_frames(draw: st.DrawFn) -> np.ndarray:
    """Noise of many kinds at full size: white, blocky, stripes, salt; no needle, no pad."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    block = draw(st.sampled_from([1, 3, 16, 40]))
    low, high = sorted(draw(st.tuples(st.integers(0, 255), st.integers(0, 255))))
    shape = (1200 // block + 1, 1600 // block + 1, draw(st.sampled_from([1, 3])))
    small = rng.integers(low, high + 1, shape, dtype=np.uint8)
    if draw(st.booleans()):
        small[:] = small[:1]
    grown = np.kron(small, np.ones((block, block, 1), dtype=np.uint8))[:1200, :1600]
    return np.ascontiguousarray(np.broadcast_to(grown, (1200, 1600, 3)))


@CALM
@given(frame=noise_frames())
def test_noise_is_never_a_tip_nor_a_control_point(model: ProbeModel, frame: np.ndarray) -> None:
    assert isinstance(find_tip(frame, model), NotFound)
    assert isinstance(find_control_point(frame, NOMINAL_TIP), NotFound)


@CALM
@given(frame=noise_frames(), radius=st.sampled_from([None, 6.0, 42.0]))
def test_noise_is_never_a_site_or_a_pad(frame: np.ndarray, radius: float | None) -> None:
    seen = find_test_points(frame, NOMINAL_TIP, 30, radius)
    assert not [point for point in seen.taken if point.radius_px > 12]


@CALM
@given(
    image=arrays(
        st.sampled_from([np.uint8, np.float32, np.int16, np.bool_]), array_shapes(min_dims=1, max_dims=4, max_side=12)
    ),
    x=st.floats(),
    y=st.floats(),
)
def test_arrays_of_any_kind_give_value_errors_or_not_found(
    model: ProbeModel, image: np.ndarray, x: float, y: float
) -> None:
    for call in (
        lambda: find_tip(image, model),
        lambda: find_test_points(image, (x, y)).nearest,
        lambda: find_control_point(image, (x, y)),
        lambda: ProbeModel.teach(image, (x, y)),
    ):
        try:
            result = call()
        except ValueError:
            continue
        assert isinstance(result, NotFound)
