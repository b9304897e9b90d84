"""Settings that numpy, OpenCV and onnxruntime read once, when they are imported."""

import os


def prepare() -> None:
    """Importing anything of this package calls it, before any of them can be imported."""
    # A robot does not phone home; onnxruntime on Linux reports usage unless told not to.
    os.environ["ORT_DISABLE_TELEMETRY"] = "1"
    # With several threads a tiny numpy product takes 10 ms instead of 0.2 (measured).
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # A camera that cannot be opened is reported by us, in one line.
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
