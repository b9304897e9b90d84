"""Pictures of gap reports as the documents show them: `gap_pictures`."""

import sys
from pathlib import Path

import numpy as np
import pytest

from mbot_workstation.measure.gap_report.page import page
from mbot_workstation.measure.gap_report.simulated_view import FramePair
from mbot_workstation.pictures.picture_file import read_picture
from mbot_workstation.sim.calibrated.calibration_folder import CalibrationFiles

from ..workstation.calibrations import BODY, CAMERA, LIGHT, MOTION
from ..workstation.gap_samples import compared_runs, report, tolerances
from . import gap_pictures
from .browser import CHROMIUM

RED_RGB = (250, 20, 30)
FRAME_SHAPE = (240, 320, 3)

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not CHROMIUM, reason="there is no Chromium: apt install chromium"),
]


def is_red(picture: np.ndarray) -> float:
    """Share of pixels that are about `RED_RGB`."""
    return float((np.abs(picture.astype(int) - RED_RGB).max(axis=-1) < 30).mean())


def test_each_section_is_cut_out_of_its_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = CalibrationFiles(
        folder=str(tmp_path), camera=CAMERA, motion=MOTION, body=BODY, light=LIGHT
    )
    red = np.full(FRAME_SHAPE, RED_RGB, np.uint8)
    frames = (FramePair("frame", red, red, red),)
    rehearsal, recordings = tmp_path / "rehearsal.html", tmp_path / "recordings.html"
    rehearsal.write_text(page(report(compared_runs(), files, tolerances(), frames=frames)))
    recordings.write_text(page(report(compared_runs(), files, tolerances())))
    monkeypatch.setattr(
        sys, "argv", ["gap_pictures", str(rehearsal), str(recordings), str(tmp_path)]
    )
    gap_pictures.main()
    names = ("gap-summary.png", "gap-paths.png", "gap-verdicts.png", "gap-frames.jpg")
    drawn = {name: read_picture(tmp_path / name) for name in names}
    for name, picture in drawn.items():
        height, width = picture.shape[:2]
        assert width == gap_pictures.WIDTH_PX
        assert 100 < height <= gap_pictures.TALLEST_PX.get(name, 2 * gap_pictures.HEIGHT_PX)
        assert picture.std() > 5, f"{name} is blank"
    assert is_red(drawn["gap-frames.jpg"]) > 0.2
    assert max(is_red(drawn[name]) for name in names if name != "gap-frames.jpg") < 0.05
