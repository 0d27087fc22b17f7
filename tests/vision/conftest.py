import pytest

from tests.vision.scene import NOMINAL_TIP, Camera, Needle, white_frame
from vision import ProbeModel


@pytest.fixture(scope="session")
def model() -> ProbeModel:
    """The needle of `scene`, taught before a quiet board."""
    return ProbeModel.teach(white_frame(Needle(), Camera(), seed=0, clutter=0.0), NOMINAL_TIP)
