"""The daemon on the robot."""

import os

# Settings that numpy, OpenCV and onnxruntime read once, when they are imported: importing anything
# of this package comes first.

# A robot does not phone home; onnxruntime on Linux reports usage unless told not to.
os.environ["ORT_DISABLE_TELEMETRY"] = "1"
# With several threads a tiny numpy product takes 10 ms instead of 0.2 (measured).
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# A camera that cannot be opened is reported by us, in one line.
os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")


def installed_version() -> str:
    """The daemon's own version. Looking it up takes longer than the rest of a command's start."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("mbot-agent")
    except PackageNotFoundError:  # run from a checkout without installing
        return "0+unknown"
