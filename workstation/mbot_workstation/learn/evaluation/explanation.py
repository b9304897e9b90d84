"""The paper's Fig. 5 of a policy, and where it looks: what it sees, what its first layer makes of
it, what it does, and what it would do without its memory.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from mbot_protocol.beat.beat import Beat
from mbot_protocol.beat.recorded_drive import read_drive
from mbot_protocol.drive.actions import Steps
from mbot_protocol.drive.camera_model import nominal_pi_camera
from mbot_protocol.drive.picture import Observer, Picture
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.policy.policy_contract import OBSERVATION_SIDE_PX, FieldOfView
from mbot_workstation.learn.evaluation.activations import (
    APART_PX,
    HIDDEN_PX,
    ActivationReader,
    Activations,
    Glance,
)
from mbot_workstation.pictures.picture_file import observation, read_picture, save_figure

_GAP = np.nan
_BLUE, _ORANGE = "#3b6ea5", "#d9772b"


def load_frame(path: Path, view: FieldOfView) -> Picture:
    """A picture file as the policy would see it. Shape (64, 64, 3).

    A picture of 64 x 64 is an observation already; any other is taken for one of the nominal
    camera and goes through the robot's own picture pipeline.

    Raises:
        ConfigurationError: it can't be read.

    """
    return as_observation(read_picture(path), view)


def as_observation(picture: Picture, view: FieldOfView) -> Picture:
    """The policy's view of a camera's picture. Shape (64, 64, 3)."""
    height_px, width_px = picture.shape[:2]
    if (height_px, width_px) == (OBSERVATION_SIDE_PX, OBSERVATION_SIDE_PX):
        return picture
    return Observer(nominal_pi_camera(width_px, height_px), view).observe(picture)


def recorded_glances(path: Path, view: FieldOfView) -> tuple[list[float], list[Glance]]:
    """All pictures of a recording: when they were seen, since the first [s], and what was seen.

    Where the policy was not asked, or a beat is missing, the next picture starts over: nobody knows
    what a policy would have had in mind.

    Raises:
        ConfigurationError: it is not a recording, or has no pictures.

    """
    times_ns: list[int] = []
    glances: list[Glance] = []
    before: Beat | None = None
    for beat in read_drive(path).beats:
        picture = observation(beat)
        if picture is None:
            before = None
            continue
        told = None if before is None else _told(before, beat)
        times_ns.append(beat.decision.unix_time_ns)
        glances.append(Glance(as_observation(picture, view), told))
        before = beat
    if not glances:
        raise ConfigurationError(f"{path} holds no pictures; was the camera running?")
    return [(at_ns - times_ns[0]) / 1e9 for at_ns in times_ns], glances


def recorded_looks(
    reader: ActivationReader, path: Path, view: FieldOfView, count: int
) -> dict[str, Activations]:
    """What a policy makes of so many pictures, evenly spread over a recording, by their times.

    Raises:
        ConfigurationError: as of `recorded_glances`.

    """
    seconds, drive = recorded_glances(path, view)
    spread = np.linspace(0, len(drive) - 1, count).round().astype(int)
    chosen = sorted(set(spread.tolist()))
    looks = reader.look_back(drive, chosen)
    return {f"{seconds[i]:.1f} s": one for i, one in zip(chosen, looks, strict=True)}


def _told(before: Beat, beat: Beat) -> tuple[float, float] | None:
    """What a policy that goes on is told of the wheels; None: it starts over, as on the robot."""
    last, now = before.decision, beat.decision
    goes_on = (
        before.decided
        and beat.decided
        and now.sequence == last.sequence + 1
        and (now.session_id, now.model_sha256) == (last.session_id, last.model_sha256)
    )
    if not goes_on:
        return None
    if beat.policy_input is not None:
        return None if beat.policy_input.began_anew else beat.told
    return Steps(last.steps.left, last.steps.right).action


def draw(seen: Mapping[str, Activations], path: Path) -> None:
    """Write the picture, a row a frame.

    Args:
        seen: by the row's title.
        path: a file matplotlib can write, such as a PNG.

    Raises:
        ConfigurationError: it can't be written.

    """
    has_layers = all(one.convolution is not None for one in seen.values())
    widths = [1, 1.2, 1.35, 1.35, 0.9] if has_layers else [1, 1.2, 0.9]
    figure = Figure(figsize=(2.5 * sum(widths), 2.75 * len(seen)), layout="constrained")
    rows: Any = figure.subplots(
        len(seen), len(widths), squeeze=False, gridspec_kw={"width_ratios": widths}
    )
    most = max(float(one.saliency.max()) for one in seen.values())
    for axes, (title, one) in zip(rows, seen.items(), strict=True):
        axes[0].imshow(one.frame)
        axes[0].set_ylabel(title, fontsize=11)
        shown = _draw_saliency(axes[1], one, most)
        for place in axes[:-1]:
            place.set_xticks([])
            place.set_yticks([])
        _draw_action(axes[-1], one)
        figure.colorbar(shown, ax=axes[1], shrink=0.8, label="change of a wheel, of full speed")
    titles = ["input", "what matters to it", "wheels"]
    if has_layers:
        titles[2:2] = _draw_layers(rows, list(seen.values()))
    for axes, title in zip(rows[0], titles, strict=True):
        axes.set_title(title, fontsize=11)
    save_figure(figure, path)


def _draw_saliency(axes: Any, one: Activations, most: float) -> Any:
    """Over the picture in gray: where hiding something changes what the wheels are told."""
    axes.imshow(one.frame.mean(axis=-1), cmap="gray", vmin=0, vmax=255)
    side, rim = OBSERVATION_SIDE_PX, (HIDDEN_PX - APART_PX) / 2
    extent = (rim - 0.5, side - rim - 0.5, side - rim - 0.5, rim - 0.5)
    share = one.saliency / max(most, 1e-6)
    shown = axes.imshow(
        one.saliency, cmap="inferno", vmin=0, vmax=most, extent=extent, alpha=0.9 * share
    )
    axes.set_xlim(-0.5, side - 0.5)
    axes.set_ylim(side - 0.5, -0.5)
    return shown


def _draw_layers(rows: Any, seen: Sequence[Activations]) -> list[str]:
    """The first layer's maps in the third and fourth column; gives their titles."""
    reach = max(float(np.abs(one.convolution).max()) for one in seen if one.convolution is not None)
    filters = 0
    for axes, one in zip(rows, seen, strict=True):
        for place, maps in ((axes[2], one.convolution), (axes[3], one.activation)):
            if maps is not None:
                place.imshow(mosaic(maps), cmap="RdBu_r", vmin=-reach, vmax=reach)
                place.set_frame_on(False)
                filters = len(maps)
    return [f"first convolution, {filters} filters", "after its activation"]


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


def _draw_action(axes: Any, one: Activations) -> None:
    axes.bar(["left", "right"], one.action, color=[_BLUE, _ORANGE], width=0.6)
    for place, value in enumerate(one.action):
        axes.text(
            place,
            value + (0.06 if value >= 0 else -0.06),
            f"{value:+.2f}",
            ha="center",
            va="bottom" if value >= 0 else "top",
            fontsize=10,
        )
    if one.first_action is not None:
        label = "without memory"
        axes.plot([0, 1], one.first_action, "D", color="black", markersize=5, label=label)
        axes.legend(fontsize=8, loc="lower center", frameon=False)
    axes.axhline(0, color="black", linewidth=0.8)
    axes.set_ylim(-1.45, 1.35)
    axes.set_yticks([-1, 0, 1])
    axes.set_ylabel("share of full speed", fontsize=9)
    axes.spines[["top", "right"]].set_visible(False)
