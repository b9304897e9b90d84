"""A camera's processing under effects."""

from mbot_workstation.sim.camera.isp import IspSettings
from mbot_workstation.sim.effects.effects import RealWorldEffects


def isp_settings(effects: RealWorldEffects, jpeg_share: float = 1.0) -> IspSettings:
    """The processing that these effects stand for.

    Args:
        effects: of one robot on one day.
        jpeg_share: how much of a frame's loss by JPEG there is in the pictures that are processed.

    """
    balance = (effects.red_gain, 1.0, effects.blue_gain)
    return IspSettings(
        gains=(
            effects.exposure_gain * balance[0],
            effects.exposure_gain * balance[1],
            effects.exposure_gain * balance[2],
        ),
        exposure_drift=effects.exposure_drift,
        auto_exposure=effects.auto_exposure,
        exposure_target=effects.exposure_target,
        auto_exposure_lag_s=effects.auto_exposure_lag_ms / 1000,
        auto_white_balance=effects.auto_white_balance,
        auto_white_balance_lag_s=effects.auto_white_balance_lag_ms / 1000,
        vignetting=effects.vignetting,
        filmic=effects.filmic,
        contrast=effects.contrast,
        black_level=effects.black_level,
        saturation=effects.saturation,
        sharpening=effects.sharpening,
        noise=effects.noise,
        chroma_noise=effects.chroma_noise,
        jpeg_quality=100 - jpeg_share * (100 - effects.jpeg_quality),
    )
