"""The same page in every format that is printed, and as it is photographed."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from mbot_protocol.drive.camera_model import nominal_pi_camera
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.rehearsal.photographs import Hold, Sheet, photograph
from mbot_workstation.measure.targets.layouts import board_page
from mbot_workstation.measure.targets.page_file import save_page, to_pdf, to_svg
from mbot_workstation.measure.targets.sheet import PAPERS
from mbot_workstation.measure.targets.specifications import Board
from mbot_workstation.sim.camera.sensor_noise import SensorNoise

PAGE = board_page(Board(9, 6, 25.0), PAPERS["a4"])


def test_a_page_keeps_its_size_in_every_format() -> None:
    pdf, svg = to_pdf(PAGE), ET.fromstring(to_svg(PAGE))
    assert pdf.startswith(b"%PDF-")
    assert pdf.rstrip().endswith(b"%%EOF")
    paper = PAPERS["a4"]
    assert {svg.get("width"), svg.get("height")} <= {
        f"{size:g}mm" for size in (paper.width_mm, paper.height_mm)
    }


def test_a_file_s_ending_says_its_format(tmp_path: Path) -> None:
    for ending, beginning in ((".pdf", b"%PDF-"), (".SVG", b"<svg"), (".png", b"\x89PNG")):
        path = tmp_path / f"board{ending}"
        save_page(path, PAGE)
        assert path.read_bytes().startswith(beginning)
    with pytest.raises(ConfigurationError):
        save_page(tmp_path / "board.doc", PAGE)


def test_a_sheet_held_before_a_camera_is_seen_in_the_middle() -> None:
    black = Sheet(np.zeros((297, 210), np.float32), 1.0)
    camera = nominal_pi_camera(320, 240)
    picture = photograph(
        black,
        camera,
        Hold((0.0, 0.0, 0.0), (0.0, 0.0, 0.6)),
        np.ones(3),
        SensorNoise(320, 240, 1),
    )
    assert picture[110:130, 150:170].mean() < 60
    assert picture[:10, :10].mean() > picture[120, 160].mean()
