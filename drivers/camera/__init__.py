"""The camera: newest frame after an instant, whatever the source."""

from drivers.camera.contract import Camera, CameraConfig, CameraStatistics, Exposed, Frame, Shown
from drivers.camera.stream import StreamCamera
from drivers.camera.v4l2 import V4L2Camera

__all__ = ["Camera", "CameraConfig", "CameraStatistics", "Exposed", "Frame", "Shown", "StreamCamera", "V4L2Camera"]
