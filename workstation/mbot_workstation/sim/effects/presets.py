"""Named sets of effects: what to train on, and what to be tried on.

`nominal` is direct transfer as in the paper: everything at its measured or best known value.
`randomised` is domain randomisation around it. The perturbations are for evaluation: `nominal`
with one thing wrong, mostly by more than `randomised` ever shows.
"""

from mbot_protocol.did_you_mean import did_you_mean
from mbot_workstation.sim.effects.effects import IDEAL, EffectRanges, RealWorldEffects

KNOWN = RealWorldEffects(
    action_latency_ms=15.0,
    action_jitter_ms=10.0,
    compensation_scale=1.0,
    dead_band_scale=1.0,
    time_constant_scale=1.0,
    camera_latency_ms=60.0,
    frame_interval_ms=1000 / 30,
    exposure_ms=20.0,
    readout_ms=23.0,
    noise=1.0,
    jpeg_quality=90.0,
)
"""What is known of any robot; its body is as it is."""

NOMINAL = EffectRanges.fixed(KNOWN)

RANDOMISED = NOMINAL.changed(
    action_latency_ms=(0.0, 50.0),
    action_jitter_ms=(0.0, 20.0),
    compensation_scale=(0.75, 1.25),
    dead_band_scale=(0.7, 1.3),
    left_gain=(0.85, 1.1),
    right_gain=(0.85, 1.1),
    speed_scale=(0.85, 1.1),
    time_constant_scale=(50 / 90, 160 / 90),
    battery_sag=(0.0, 0.1),
    friction_scale=(0.5, 1.1),
    mass_scale=(0.8, 1.2),
    wheel_radius_scale=(0.97, 1.03),
    track_scale=(0.96, 1.04),
    camera_latency_ms=(30.0, 110.0),
    exposure_ms=(8.0, 30.0),
    readout_ms=(15.0, 30.0),
    exposure_gain=(0.65, 1.3),
    exposure_drift=(0.0, 0.1),
    red_gain=(0.88, 1.12),
    blue_gain=(0.88, 1.12),
    noise=(0.5, 4.0),
    jpeg_quality=100.0,  # left out: costs a tenth, and its 0.8 grey levels are within the noise
    fov_scale=(0.96, 1.04),
    principal_right=(-0.02, 0.02),
    principal_down=(-0.02, 0.02),
    lens_k1=(-0.12, 0.02),
    lens_k2=(-0.01, 0.05),
    camera_up_mm=(-8.0, 8.0),
    camera_pitch_deg=(-2.5, 2.5),
    camera_yaw_deg=(-2.5, 2.5),
    camera_roll_deg=(-1.5, 1.5),
    cube_brightness=(0.8, 1.15),
    floor_brightness=(0.7, 1.1),
    auto_exposure=(0.0, 1.0),
    exposure_target=(0.3, 0.6),
    auto_exposure_lag_ms=(100.0, 1500.0),
    auto_white_balance=(0.0, 0.9),
    auto_white_balance_lag_ms=(200.0, 4000.0),
    vignetting=(0.0, 0.5),
    filmic=(0.0, 1.0),
    contrast=(-0.2, 0.8),
    black_level=(-0.04, 0.06),
    saturation=(0.7, 1.35),
    sharpening=(0.0, 1.2),
    chroma_noise=(0.0, 4.0),
    scene_variety=0.85,
)
"""Ranges of a camera's processing are assumed: from a plain sensor to a phone's pictures."""

PI_CAMERA = NOMINAL.changed(
    auto_exposure=1.0,
    exposure_target=0.42,
    auto_exposure_lag_ms=400.0,
    auto_white_balance=0.7,
    auto_white_balance_lag_ms=800.0,
    vignetting=0.25,
    filmic=0.7,
    contrast=0.35,
    saturation=1.1,
    sharpening=0.5,
    chroma_noise=1.5,
)
"""A Raspberry Pi camera left to its automatics: contrasty curve, sharpening, exposure and white
balance that follow the picture. Assumed, as far as that is public."""

LIVED_IN = RANDOMISED.changed(clutter=0.65)
"""For training: `randomised`, and two of three arenas that look like any are homes."""

HELD_MS = 1e9
"""A time constant with which automatics stay where an episode's first picture puts them: what the
daemon does with `camera.automatic = "settle"`."""

PERTURBATIONS: dict[str, EffectRanges] = {
    "uneven": NOMINAL.changed(left_gain=1.0, right_gain=0.85),
    "handicap": NOMINAL.changed(left_gain=1.0, right_gain=0.5),
    "sluggish": NOMINAL.changed(time_constant_scale=200 / 90),
    "slippery": NOMINAL.changed(friction_scale=0.25),
    "blurry": NOMINAL.changed(exposure_ms=30.0),
    "noisy": NOMINAL.changed(noise=5.0, jpeg_quality=60.0),
    "distorted": NOMINAL.changed(lens_k1=-0.10, lens_k2=0.04, fov_scale=0.95, camera_pitch_deg=2.0),
    "dim": NOMINAL.changed(exposure_gain=0.55),
    "bright": NOMINAL.changed(exposure_gain=1.5),
    "late": NOMINAL.changed(camera_latency_ms=150.0),
    "automatic": PI_CAMERA,
    "any-room": PI_CAMERA.changed(scene_variety=1.0),
    "home": PI_CAMERA.changed(scene_variety=1.0, clutter=1.0),
    "light-held": PI_CAMERA.changed(
        scene_variety=1.0, auto_exposure_lag_ms=HELD_MS, auto_white_balance_lag_ms=HELD_MS
    ),
}
"""For evaluation only: nothing is trained on these."""

PRESETS: dict[str, EffectRanges] = {
    "ideal": EffectRanges.fixed(IDEAL),
    "nominal": NOMINAL,
    "randomised": RANDOMISED,
    **PERTURBATIONS,
}

SHARP = RANDOMISED.changed(exposure_ms=0.0, readout_ms=0.0)
"""For training only: what a policy learns that never saw a turn blur its pictures, as the paper's
before its blur lesson."""

_BY_NAME = {**PRESETS, "lived-in": LIVED_IN, "sharp": SHARP}


def preset(name: str, calibrated: RealWorldEffects | None = None) -> EffectRanges:
    """Look a preset up.

    Args:
        name: of the preset.
        calibrated: the effects of one robot, to centre the preset on; None is the nominal robot.

    Raises:
        ValueError: there is none of this name, or it can't be centred.

    """
    if name not in _BY_NAME:
        meant = did_you_mean(name, _BY_NAME)
        raise ValueError(f"no preset {name!r}, expected one of {', '.join(_BY_NAME)}{meant}")
    if calibrated is None:
        return _BY_NAME[name]
    if name == "ideal":
        raise ValueError("the preset 'ideal' is no real robot, expected another with a calibration")
    return _BY_NAME[name].moved(KNOWN, calibrated)
