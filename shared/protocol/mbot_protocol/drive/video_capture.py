"""A camera device, a video file, or what FFmpeg opens, by OpenCV: opened one way on both sides."""

import cv2


def device_index(source: str) -> int | None:
    """The number of a camera given as "0" or "/dev/video0"; None for files and addresses."""
    digits = source.removeprefix("/dev/video")
    return int(digits) if digits.isascii() and digits.isdigit() else None


def open_capture(source: str, open_timeout_s: float, read_timeout_s: float) -> cv2.VideoCapture:
    """OpenCV's capture; the caller looks whether it is opened, and releases it.

    Args:
        source: a device, an address or a file.
        open_timeout_s, read_timeout_s: of what is not a device: one that is gone must not hang.

    """
    index = device_index(source)
    if index is None:
        timeouts = [
            *(cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, int(open_timeout_s * 1000)),
            *(cv2.CAP_PROP_READ_TIMEOUT_MSEC, int(read_timeout_s * 1000)),
        ]
        return cv2.VideoCapture(source, cv2.CAP_FFMPEG, timeouts)
    capture = cv2.VideoCapture(index)
    capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)  # the newest frame, not one from a second ago
    return capture
