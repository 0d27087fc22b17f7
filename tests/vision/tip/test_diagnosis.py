"""Names of what is wrong with a needle: none that the taught one does not deserve."""

import pytest

from tests.vision.scene import AXIS_DEG, NOMINAL_TIP, Camera, Canvas, side_lit, white_frame
from vision import NotFound, ProbeModel, find_tip


@pytest.mark.parametrize(("near", "far", "from_px"), [(50.0, 110.0, 60.0), (110.0, 110.0, 150.0), (130.0, 50.0, 150.0)])
def test_the_taught_needle_before_a_grey_body_is_not_called_a_narrower_one(
    near: float, far: float, from_px: float
) -> None:
    """Its streak of light is the only bar that shows there."""
    needle = side_lit(-1, tapered=False)
    taught = ProbeModel.teach(white_frame(needle, Camera(), 0, 0.0), needle.tip)

    def body(canvas: Canvas) -> None:
        canvas.level[:] = near
        canvas.paint(canvas.along(NOMINAL_TIP, AXIS_DEG)[0] + from_px, far)

    result = find_tip(white_frame(needle, Camera(), 1, 0.0, more=body), taught)
    assert isinstance(result, NotFound)
    assert "px wide" not in result.message
