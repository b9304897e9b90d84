"""Where frames come from: the Pi camera, JPEGs over HTTP, or what OpenCV opens."""

from mbot_agent.camera.opencv_source import OpenCvSource, device_index
from mbot_agent.camera.pi_camera_source import PiCameraSource
from mbot_agent.camera.source_contract import FrameSource
from mbot_agent.configuration import CameraSettings


def frame_source(camera: CameraSettings) -> FrameSource:
    """The source a configuration names; not opened yet."""
    if camera.source == "picamera2":
        return PiCameraSource(camera)
    if camera.source.startswith("http://"):
        # Python's HTTP and TLS come with it, 2 MB that a robot's own camera does not need.
        from mbot_agent.camera.mjpeg_source import MjpegSource

        return MjpegSource(camera.source)
    return OpenCvSource(camera)


def is_real_camera(camera: CameraSettings) -> bool:
    """Whether frames come from a sensor on this machine, whose noise makes each one different."""
    return camera.source == "picamera2" or device_index(camera.source) is not None
