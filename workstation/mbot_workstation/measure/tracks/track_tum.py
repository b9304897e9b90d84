"""Writing tracks in TUM format: `time x y z qx qy qz qw`, seconds and metres, z up."""

import io
from pathlib import Path

import numpy as np

from mbot_protocol.files import atomic_file
from mbot_workstation.sim.track import Track

HEADER = "time_s x_m y_m z_m qx qy qz qw"


def write_tum(path: Path, track: Track) -> None:
    """Write the whole track, or leave the file as it was; raises ConfigurationError."""
    table = np.column_stack(
        [track.time_s, track.position_m, np.roll(track.quaternion_wxyz, -1, axis=1)]
    )
    formats = ["%.6f", *["%.6f"] * 3, *["%.9f"] * 4]
    text = io.BytesIO()
    np.savetxt(text, table, fmt=formats, header=HEADER)
    atomic_file.save(path, text.getvalue())
