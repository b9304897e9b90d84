"""Where the policy that drove looked: what matters to it in a recorded picture, drawn over it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from mbot_protocol.beat.beat import Beat, BeatKey
from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.fleet.models.check import check_model
from mbot_workstation.learn.evaluation.activations import ActivationReader, Activations
from mbot_workstation.look.drives.replayed_drive import find_model
from mbot_workstation.pictures.picture_file import observation

GLOW = (255, 150, 30)

NOTICED = 0.05
"""Change of a wheel, of full speed, below which nothing mattered: else noise would glow."""


@dataclass(frozen=True, slots=True)
class Look:
    """What a policy made of one picture.

    Attributes:
        picture: what it saw in gray, with what mattered glowing, shape (64, 64, 3).
        without_memory: what it would have done if nothing had been before; None if nothing had.

    """

    picture: Picture
    without_memory: tuple[float, float] | None


Looks = Mapping[BeatKey, Look]


def attention(beats: Sequence[Beat], models: Sequence[Path]) -> tuple[Looks, list[str]]:
    """What mattered in these beats' pictures to the policy, with what it had in mind then.

    Args:
        beats: of the robot's own recording; others, and those without a decision, are left out.
        models: files among which those that drove are looked for, by their digests.

    Returns:
        What there is, and why some is not there, in words.

    """
    found: dict[BeatKey, Activations] = {}
    words: list[str] = []
    shown = [beat for beat in beats if beat.decided and beat.is_replayable]
    if len(shown) < sum(beat.decided for beat in beats):
        words.append("where it looked is not known of pictures that only telemetry has brought")
    for digest in dict.fromkeys(beat.decision.model_sha256 for beat in shown):
        try:
            reader = ActivationReader(check_model(find_model(digest, models)).data)
        except ConfigurationError as error:
            words.append(f"where it looked is not shown: {error}")
            continue
        for beat in shown:
            known, picture = beat.policy_input, observation(beat)
            if beat.decision.model_sha256 == digest and known is not None and picture is not None:
                memory = b"" if known.began_anew else known.memory
                seen = reader.look_on(picture, beat.told or (0.0, 0.0), memory)
                found[beat.key] = seen
    looks = {key: Look(_glowing(one), one.first_action) for key, one in found.items()}
    return looks, words


def _glowing(one: Activations) -> Picture:
    """The picture in gray, with what mattered most in it glowing brightest."""
    side = one.frame.shape[0]
    gray = np.repeat(one.frame.mean(axis=-1, keepdims=True) * 0.6, 3, axis=-1)
    most = max(NOTICED, float(one.saliency.max()))
    share = cv2.resize(one.saliency / most, (side, side), interpolation=cv2.INTER_LINEAR)
    glow = np.clip(share, 0, 1)[..., None]
    return (gray * (1 - glow) + np.array(GLOW) * glow).round().astype(np.uint8)
