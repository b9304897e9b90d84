"""A recorded drive as a film: what the policy saw, and what its wheels were told."""

from collections.abc import Sequence
from pathlib import Path
from typing import cast

import cv2
from PIL import Image

from mbot_protocol.beat.beat import Beat
from mbot_protocol.beat.changes import decision_state
from mbot_protocol.beat.recorded_drive import RecordedDrive
from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.pictures.film_tile import INK, blank, caption_px, draw_tile, wheel_bars, write
from mbot_workstation.pictures.picture_file import observation

RATE_HZ = 10
"""A beat is shown for as long as it lasted; 20 beats a second are shown every other one."""

SCALE = 4
"""Of a tile of 128 pixels: seen from across a room."""

GIF_COLOURS = 64

LONGEST_GAP_S = 2.0
"""What lies between two files or two drives is not waited for."""


def film(drive: RecordedDrive, path: Path) -> float:
    """Write the film, MP4 or GIF by its name; returns how long it is, in seconds.

    Raises:
        ConfigurationError: the recording has no pictures, or the file cannot be written.

    """
    beats = [beat for beat in drive.beats if beat.encoded]
    if not beats:
        raise ConfigurationError(f"{drive.name} holds no pictures: nothing to be filmed")
    timed = [
        (beat, _lasts_s(beat, following, drive))
        for beat, following in zip(beats, [*beats[1:], None], strict=True)
    ]
    make = _write_gif if path.suffix == ".gif" else _write_mp4
    return make(drive, timed, path)


def _write_gif(drive: RecordedDrive, timed: Sequence[tuple[Beat, float]], path: Path) -> float:
    """A frame a beat, half as large: for pages that show no MP4."""
    frames = (
        Image.fromarray(_frame(drive, beat)[::2, ::2]).quantize(GIF_COLOURS) for beat, _ in timed
    )
    # A GIF counts hundredths of a second.
    lasts_ms = [max(20, round(100 * lasts_s) * 10) for _, lasts_s in timed]
    try:
        next(frames).save(
            path, save_all=True, append_images=frames, duration=lasts_ms, loop=0, optimize=True
        )
    except OSError as error:
        raise ConfigurationError(f"can't write a film to {path}: {error.strerror}") from None
    return sum(lasts_ms) / 1000


def _write_mp4(drive: RecordedDrive, timed: Sequence[tuple[Beat, float]], path: Path) -> float:
    size = _frame(drive, timed[0][0]).shape
    writer = cv2.VideoWriter(
        str(path), cv2.VideoWriter.fourcc(*"mp4v"), RATE_HZ, (size[1], size[0])
    )
    if not writer.isOpened():
        raise ConfigurationError(
            f"can't write a film to {path}; give a writable NAME.mp4 or NAME.gif"
        )
    shown, elapsed_s = 0, 0.0
    try:
        for beat, lasts_s in timed:
            elapsed_s += lasts_s
            frames = round(elapsed_s * RATE_HZ) - shown
            if frames:
                picture = cv2.cvtColor(_frame(drive, beat), cv2.COLOR_RGB2BGR)
                for _ in range(frames):
                    writer.write(picture)
            shown += frames
    finally:
        writer.release()
    return shown / RATE_HZ


def _lasts_s(beat: Beat, following: Beat | None, drive: RecordedDrive) -> float:
    """Until the next beat begins; the last one as long as the robot's period."""
    if following is None:
        return 1 / drive.facts.decision_rate_hz if drive.facts is not None else 0.4
    return min(LONGEST_GAP_S, max(0.0, drive.since_s(following) - drive.since_s(beat)))


def _frame(drive: RecordedDrive, beat: Beat) -> Picture:
    """One picture of the film, RGB; the same size for each beat."""
    decision = beat.decision
    seen = observation(beat)
    small = blank(128 + caption_px(2), 128)
    draw_tile(small, blank(64, 64) if seen is None else seen, "", wheel_bars(drive.at_wheels(beat)))
    height, width = SCALE * small.shape[0], SCALE * small.shape[1]
    nearest = cv2.INTER_NEAREST
    large = cast(Picture, cv2.resize(small, (width, height), interpolation=nearest))
    words = f"{drive.since_s(beat):.1f} s  {decision_state(decision)}"
    write(large, words, (8, 128 * SCALE + 40), INK, 0.6)
    faults = ", ".join(fault.kind for fault in decision.faults)
    write(large, faults.encode("ascii", "replace").decode()[:50], (8, height - 16), INK, 0.5)
    # MP4 wants even sides.
    return large[: height // 2 * 2, : width // 2 * 2]
