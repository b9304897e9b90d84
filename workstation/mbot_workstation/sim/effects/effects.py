"""What tells a real robot from an ideal one: every effect a number with a unit and an off value.

Direct transfer as in the paper gives each its measured value; domain randomisation draws each
from a range. The simulation reads nothing else, so a study changes one field.
"""

import math
from dataclasses import astuple, dataclass, fields, replace
from typing import Self

import numpy as np

_POSITIVE = frozenset(
    {
        "left_gain",
        "right_gain",
        "speed_scale",
        "time_constant_scale",
        "friction_scale",
        "mass_scale",
        "wheel_radius_scale",
        "track_scale",
        "exposure_gain",
        "red_gain",
        "blue_gain",
        "jpeg_quality",
        "fov_scale",
        "cube_brightness",
        "floor_brightness",
        "exposure_target",
        "auto_exposure_lag_ms",
        "auto_white_balance_lag_ms",
        "saturation",
    }
)
"""Of no meaning at 0 or below."""

_SIGNED = frozenset(
    {
        "principal_right",
        "principal_down",
        "lens_k1",
        "lens_k2",
        "camera_up_mm",
        "camera_pitch_deg",
        "camera_yaw_deg",
        "camera_roll_deg",
        "contrast",
        "black_level",
    }
)


@dataclass(frozen=True, slots=True)
class RealWorldEffects:
    """One robot on one day. The defaults are the off values: an ideal robot.

    What concerns the body is a change of the robot's own parameters (`RobotParameters`, made by
    `perturbed_robot`), so a calibrated robot keeps its calibration. Origins: facts of a unit as
    measured or public where said; the rest are estimates.

    Attributes:
        action_latency_ms: from the decision's tick to the wheels' voltage: inference and serial
            line. Off 0.
        action_jitter_ms: drawn evenly from 0 to this at every decision and added. Off 0.
        compensation_scale: of the board speed above which the robot's `MotorMap` starts its steps,
            a setting of the robot. Off 0.
        dead_band_scale: of the board speed up to which the wheels stand; public notes: 40-60 of
            255. Off 0.
        left_gain, right_gain: strength of a motor, of its own; +-5 % a side is usual, 0.5 is the
            paper's handicap. Off 1.
        speed_scale: free wheel speed of both; other units have 105-132 of 120 rpm. Off 1.
        time_constant_scale: of a wheel's speed; 60-120 of 90 ms. Off 2/3, the quickest: less than
            its mass allows a robot would slip and tip.
        battery_sag: share of the voltage lost at full command on both motors, beyond the robot's
            own. The paper measured none (3.9 V at 3.7 V rated), thanks to its second battery.
            Off 0.
        friction_scale: of the wheels on the floor; 0.25 slips in every start. Off 1.
        mass_scale: 0.8-1.1 kg of 0.94. Off 1.
        wheel_radius_scale, track_scale: +-0.6 of 32.5 mm, +-2 of 115 mm. Off 1.
        camera_latency_ms: from the middle of the exposure until the picture can be used; 40-80.
            Off 0.
        frame_interval_ms: the newest frame is older by an even draw from 0 to this: the camera
            runs on its own clock at 30 frames/s, 33 ms. Off 0.
        exposure_ms: time a row collects light, during which a turn blurs it; 10-30. Off 0.
        readout_ms: from the first row's exposure to the last one's, in which a turn shears the
            picture; about 23 for the IMX477. Off 0.
        exposure_gain: brightness; 0.8-1.15. Off 1.
        exposure_drift: the gain swings by this share up and down over 20 s. Off 0.
        red_gain, blue_gain: white balance against green. Off 1.
        noise: of the sensor, 1 is `SensorNoise`'s. Off 0.
        jpeg_quality: of the camera's frames, 1-100. Off 100, which leaves out the coder.
        fov_scale: focal length is divided by this. Off 1.
        principal_right, principal_down: of the optical axis in the picture, in shares of its
            width and height; within 0.02. Off 0.
        lens_k1, lens_k2: distortion nobody calibrated, as OpenCV counts it; -0.1..0, 0..0.04.
            Off 0.
        camera_up_mm: the mount is higher than it should be; +-5. Off 0.
        camera_pitch_deg, camera_yaw_deg, camera_roll_deg: further down, to the left, clockwise;
            +-1.5, +-1.5, +-1. Off 0.
        cube_brightness, floor_brightness: of their colours, as paint and light vary. Off 1.
        auto_exposure: how much of the way to its target an automatic exposure goes, 0-1. Off 0.
        exposure_target: mean display level it aims at, of 1. Off 0.45.
        auto_exposure_lag_ms: its time constant; some frames to a second. Off 500.
        auto_white_balance: how much of a picture's tint is taken for the light's, 0-1. Off 0.
        auto_white_balance_lag_ms: its time constant. Off 1000.
        vignetting: share of the light missing in the corners. Off 0.
        filmic: how much of a filmic curve's shoulder, 0-1. Off 0.
        contrast: how much of an S-curve; flat ones below 0. Off 0.
        black_level: what black shows as; crushed below 0. Off 0.
        saturation: of colours. Off 1.
        sharpening: strength of the camera's unsharp mask. Off 0.
        chroma_noise: blotches of colour, in levels of 255. Off 0.
        scene_variety: how often an episode's arena looks like any (`scene_looks.py`) and not like
            the nominal one, 0-1. Off 0.
        clutter: share of these in which somebody lives (`home_looks.py`): things stand about, and
            the floor may mirror. Off 0.

    Raises:
        ValueError: a value is not finite or cannot be.

    """

    action_latency_ms: float = 0.0
    action_jitter_ms: float = 0.0
    compensation_scale: float = 0.0
    dead_band_scale: float = 0.0
    left_gain: float = 1.0
    right_gain: float = 1.0
    speed_scale: float = 1.0
    time_constant_scale: float = 60 / 90
    battery_sag: float = 0.0
    friction_scale: float = 1.0
    mass_scale: float = 1.0
    wheel_radius_scale: float = 1.0
    track_scale: float = 1.0
    camera_latency_ms: float = 0.0
    frame_interval_ms: float = 0.0
    exposure_ms: float = 0.0
    readout_ms: float = 0.0
    exposure_gain: float = 1.0
    exposure_drift: float = 0.0
    red_gain: float = 1.0
    blue_gain: float = 1.0
    noise: float = 0.0
    jpeg_quality: float = 100.0
    fov_scale: float = 1.0
    principal_right: float = 0.0
    principal_down: float = 0.0
    lens_k1: float = 0.0
    lens_k2: float = 0.0
    camera_up_mm: float = 0.0
    camera_pitch_deg: float = 0.0
    camera_yaw_deg: float = 0.0
    camera_roll_deg: float = 0.0
    cube_brightness: float = 1.0
    floor_brightness: float = 1.0
    auto_exposure: float = 0.0
    exposure_target: float = 0.45
    auto_exposure_lag_ms: float = 500.0
    auto_white_balance: float = 0.0
    auto_white_balance_lag_ms: float = 1000.0
    vignetting: float = 0.0
    filmic: float = 0.0
    contrast: float = 0.0
    black_level: float = 0.0
    saturation: float = 1.0
    sharpening: float = 0.0
    chroma_noise: float = 0.0
    scene_variety: float = 0.0
    clutter: float = 0.0

    def __post_init__(self) -> None:
        for name in EFFECT_NAMES:
            value = getattr(self, name)
            if not math.isfinite(value):
                raise ValueError(f"{name} is {value}, expected a finite number")
            if name in _POSITIVE and value <= 0:
                raise ValueError(f"{name} is {value}, expected above 0")
            if name not in _SIGNED and value < 0:
                raise ValueError(f"{name} is {value}, expected at least 0")
        if self.battery_sag >= 1 or self.exposure_drift >= 1:
            raise ValueError("battery_sag and exposure_drift are shares, expected below 1")


EFFECT_NAMES = tuple(field.name for field in fields(RealWorldEffects))

IDEAL = RealWorldEffects()


@dataclass(frozen=True, slots=True)
class EffectRanges:
    """Every effect between two values; a robot is one draw.

    Attributes:
        low, high: the two corners; equal fields are fixed.

    Raises:
        ValueError: a low value is above its high one.

    """

    low: RealWorldEffects
    high: RealWorldEffects

    def __post_init__(self) -> None:
        for name in EFFECT_NAMES:
            low, high = getattr(self.low, name), getattr(self.high, name)
            if low > high:
                raise ValueError(f"{name} goes from {low} to {high}, expected a rising range")

    @classmethod
    def fixed(cls, effects: RealWorldEffects) -> Self:
        """The same robot always."""
        return cls(effects, effects)

    @property
    def is_fixed(self) -> bool:
        """Whether every draw is the same."""
        return self.low == self.high

    def sample(self, rng: np.random.Generator) -> RealWorldEffects:
        """Draw a robot, each effect evenly and by itself."""
        # Clutter came later. It has the draw before it besides, so that seeds mean what they meant.
        share = rng.random(len(EFFECT_NAMES) - 1)
        share = np.append(share, share[-1])
        low, high = np.array(astuple(self.low)), np.array(astuple(self.high))
        return RealWorldEffects(*(low + share * (high - low)).tolist())

    def moved(self, origin: RealWorldEffects, to: RealWorldEffects) -> Self:
        """The same ranges around another robot.

        What is of no meaning at 0 is scaled by what the two robots differ, the rest is shifted,
        though never below 0 where that can't be.

        Args:
            origin: the robot the ranges are around.
            to: the robot they shall be around; effects in which the two agree stay as they are.

        """
        pairs: dict[str, float | tuple[float, float]] = {}
        for name in EFFECT_NAMES:
            here, there = getattr(origin, name), getattr(to, name)
            if here == there:
                continue
            ends = getattr(self.low, name), getattr(self.high, name)
            if name in _POSITIVE:
                low, high = (end * there / here for end in ends)
            else:
                least = -math.inf if name in _SIGNED else 0.0
                low, high = (max(end + there - here, least) for end in ends)
            pairs[name] = low, high
        return self.changed(**pairs)

    def changed(self, **effects: float | tuple[float, float]) -> Self:
        """The same ranges but for these effects: a number fixes one, a pair is its range."""
        pairs = {
            name: value if isinstance(value, tuple) else (value, value)
            for name, value in effects.items()
        }
        return type(self)(
            replace(self.low, **{name: pair[0] for name, pair in pairs.items()}),
            replace(self.high, **{name: pair[1] for name, pair in pairs.items()}),
        )
