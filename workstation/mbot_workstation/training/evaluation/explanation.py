"""The paper's Fig. 5 of a policy: what it sees, what its first layer makes of it, what it does."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from mbot_protocol.camera_model import nominal_pi_camera
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.picture import Observer, Picture
from mbot_protocol.policy_contract import OBSERVATION_SIDE_PX, FieldOfView
from mbot_workstation.pictures.picture_file import decode_picture, save_figure
from mbot_workstation.training.evaluation.activations import Activations

_GAP = np.nan
_BLUE, _ORANGE = "#3b6ea5", "#d9772b"


def load_frame(path: Path, view: FieldOfView) -> Picture:
    """A picture file as the policy would see it. Shape (64, 64, 3).

    A picture of 64 x 64 is an observation already; any other is taken for one of the nominal
    camera and goes through the robot's own picture pipeline.

    Raises:
        ConfigurationError: it can't be read.

    """
    try:
        picture = decode_picture(path.read_bytes())
    except OSError as error:
        raise ConfigurationError(f"can't read {path}: {error.strerror}") from None
    if picture is None:
        raise ConfigurationError(f"{path} is no picture; expected a PNG or JPEG file")
    return as_observation(picture, view)


def as_observation(picture: Picture, view: FieldOfView) -> Picture:
    """The policy's view of a camera's picture. Shape (64, 64, 3)."""
    height_px, width_px = picture.shape[:2]
    if (height_px, width_px) == (OBSERVATION_SIDE_PX, OBSERVATION_SIDE_PX):
        return picture
    return Observer(nominal_pi_camera(width_px, height_px), view).observe(picture)


def recorded_frames(path: Path, count: int, view: FieldOfView) -> dict[str, Picture]:
    """Frames evenly spread over a recording, by the second they were seen in.

    Raises:
        ConfigurationError: it is no recording, or has no pictures.

    """
    from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage

    from mbot_workstation.recordings.drive_mcap import read_recording

    messages = [m for _, m in read_recording(path) if isinstance(m, CompressedImage)]
    if not messages:
        raise ConfigurationError(f"{path} holds no pictures; was the camera running?")
    start_ns = messages[0].timestamp.ToNanoseconds()
    frames: dict[str, Picture] = {}
    for index in np.unique(np.linspace(0, len(messages) - 1, count).round().astype(int)):
        picture = decode_picture(messages[index].data)
        if picture is not None:
            seconds = (messages[index].timestamp.ToNanoseconds() - start_ns) / 1e9
            frames[f"{seconds:.1f} s"] = as_observation(picture, view)
    return frames


def draw(seen: Mapping[str, Activations], path: Path) -> None:
    """Write the picture, a row a frame.

    Args:
        seen: by the row's title.
        path: a file matplotlib can write, such as a PNG.

    Raises:
        ConfigurationError: it can't be written.

    """
    figure = Figure(figsize=(11, 2.75 * len(seen)), layout="constrained")
    rows: Any = figure.subplots(
        len(seen), 4, squeeze=False, gridspec_kw={"width_ratios": [1, 1.35, 1.35, 0.8]}
    )
    reach = max(float(np.abs(one.convolution).max()) for one in seen.values())
    for axes, (title, one) in zip(rows, seen.items(), strict=True):
        axes[0].imshow(one.frame)
        axes[0].set_ylabel(title, fontsize=11)
        for place, maps in ((axes[1], one.convolution), (axes[2], one.activation)):
            place.imshow(mosaic(maps), cmap="RdBu_r", vmin=-reach, vmax=reach)
        for place in axes[:3]:
            place.set_xticks([])
            place.set_yticks([])
        for place in axes[1:3]:
            place.set_frame_on(False)
        _draw_action(axes[3], one.action)
    filters = len(next(iter(seen.values())).convolution)
    titles = ("input", f"first convolution, {filters} filters", "after LeakyReLU", "wheels")
    for axes, title in zip(rows[0], titles, strict=True):
        axes.set_title(title, fontsize=11)
    save_figure(figure, path)


def mosaic(maps: NDArray[np.float32]) -> NDArray[np.float32]:
    """Feature maps side by side, as square as it gets, one pixel apart.

    Args:
        maps: shape (n, h, w).

    Returns:
        Shape (rows (h + 1) - 1, columns (w + 1) - 1); NaN between them.

    """
    count, height, width = maps.shape
    columns = int(np.ceil(np.sqrt(count)))
    rows = int(np.ceil(count / columns))
    tiles = np.full((rows * columns, height + 1, width + 1), _GAP, np.float32)
    tiles[:count, :-1, :-1] = maps
    wall = tiles.reshape(rows, columns, height + 1, width + 1).swapaxes(1, 2)
    return wall.reshape(rows * (height + 1), columns * (width + 1))[:-1, :-1]


def _draw_action(axes: Any, action: Sequence[float]) -> None:
    axes.bar(["left", "right"], action, color=[_BLUE, _ORANGE], width=0.6)
    for place, value in enumerate(action):
        axes.text(
            place,
            value + (0.06 if value >= 0 else -0.06),
            f"{value:+.2f}",
            ha="center",
            va="bottom" if value >= 0 else "top",
            fontsize=10,
        )
    axes.axhline(0, color="black", linewidth=0.8)
    axes.set_ylim(-1.35, 1.35)
    axes.set_yticks([-1, 0, 1])
    axes.spines[["top", "right"]].set_visible(False)
