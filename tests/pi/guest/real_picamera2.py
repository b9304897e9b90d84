"""The daemon's camera source over the real picamera2 and libcamera's virtual camera; prints JSON.

That camera has no raw stream and knows NV12 only, where a Raspberry Pi's has both: `raw modes` is
answered for it, and NV12 is asked for. Its buffers are mapped as long as they are: it leaves empty
how much of them it has written.
"""

import importlib
import json
import mmap
import sys
import time
from typing import Any


def main() -> None:
    sys.path[:0] = ["/opt/picamera2", "/opt/stand-ins"]
    sys.path.append("/usr/lib/python3/dist-packages")
    picamera2: Any = importlib.import_module("picamera2")
    allocators: Any = importlib.import_module("picamera2.allocators")
    allocator: Any = importlib.import_module("picamera2.allocators.allocator")
    from mbot_agent.camera import pi_camera_source
    from mbot_agent.camera.source_contract import CameraError
    from mbot_agent.configuration import CameraSettings

    class Mapped(allocator.Sync):
        def __init__(self, _: Any, buffer: Any, write: bool) -> None:
            self.buffer = buffer

        def __enter__(self) -> mmap.mmap:
            planes = self.buffer.planes
            self.memory = mmap.mmap(planes[0].fd, sum(plane.length for plane in planes))
            return self.memory

        def __exit__(self, *_: object) -> None:
            self.memory.close()

    class Camera2(picamera2.Picamera2):
        def __init__(self) -> None:
            super().__init__()
            self.allocator = allocators.LibcameraAllocator(self.camera)
            self.allocator.sync = Mapped

        def _get_raw_modes(self) -> list[dict[str, Any]]:
            return [{"format": "SRGGB12", "size": pi_camera_source.SENSOR_MODE}]

        def create_video_configuration(self, **settings: Any) -> dict[str, Any]:
            return super().create_video_configuration(raw=None, **settings)

    picamera2.Picamera2 = Camera2
    said: dict[str, Any] = {"cameras": len(Camera2.global_camera_info())}
    source = pi_camera_source.PiCameraSource(CameraSettings())
    try:
        source.__enter__()
    except CameraError as error:
        said["in another format"] = str(error)
    pi_camera_source.PIXEL_FORMAT = "NV12"
    with source:
        began_s = time.monotonic()
        shots = [source.read() for _ in range(20)]
        said["20 shots s"] = time.monotonic() - began_s
        said["shape"] = shots[0].picture().shape
        said["ages s"] = [time.monotonic() - shot.captured_ns / 1e9 for shot in shots[-2:]]
        said["light held"] = source.hold_light(True)
    with source:
        said["again"] = source.read().picture().shape
    print(json.dumps(said), flush=True)


if __name__ == "__main__":
    main()
