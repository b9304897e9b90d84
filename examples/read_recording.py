"""Read a recording: a robot's own folder, or a file of `telemetry --record` or `robot.record`."""

import sys
from pathlib import Path

import numpy as np

from mbot import read_recording

SMALL = Path(__file__).parents[1] / "tests" / "data" / "recorded-drive"

beats = list(read_recording(Path(*sys.argv[1:]) if sys.argv[1:] else SMALL))
actions = np.array([beat.action for beat in beats if beat.action])
pictures = [beat.frame for beat in beats if beat.frame is not None]
print(f"{len(beats)} beats in {beats[-1].monotonic_s - beats[0].monotonic_s:.1f} s")
print(f"states: {', '.join(sorted({beat.state for beat in beats}))}")
print(f"{len(actions)} actions, mean wheels {actions.mean(axis=0).round(2)}")
print(f"{len(pictures)} pictures, shape {pictures[0].shape}, brightness {np.mean(pictures):.0f}")
