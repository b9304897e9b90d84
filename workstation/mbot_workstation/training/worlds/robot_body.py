"""What a robot's body makes of its commands, as numbers that drivers may be told."""

import numpy as np

from mbot_protocol.actions import WheelMaps
from mbot_workstation.variation.effects import EffectRanges, RealWorldEffects
from mbot_workstation.variation.perturbed_robot import trimmed

BODY = (
    "left_gain",
    "right_gain",
    "speed_scale",
    "wheel_radius_scale",
    "track_scale",
    "dead_band",
    "dead_band_compensation",
    "action_latency_ms",
    "action_jitter_ms",
    "time_constant_ms",
    "friction_scale",
    "camera_latency_ms",
)
"""Fields of `RealWorldEffects`, which has their units; the gains are those left by motor trims."""

BODY_RECORD = np.dtype([(name, np.float32) for name in BODY])


def body_record(effects: RealWorldEffects, maps: WheelMaps) -> tuple[float, ...]:
    """One robot's BODY_RECORD.

    Args:
        effects: on it.
        maps: its daemon's motor maps.

    """
    body = trimmed(EffectRanges.fixed(effects), maps).low
    return tuple(getattr(body, name) for name in BODY)
