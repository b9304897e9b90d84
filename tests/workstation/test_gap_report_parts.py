"""The sections and plots of the gap report, each by itself."""

import math
from dataclasses import replace

import numpy as np
import pytest

from mbot_workstation.gap_report.camera_section import camera_section
from mbot_workstation.gap_report.compared_run import CALIBRATED, NOMINAL
from mbot_workstation.gap_report.comparison import line_at
from mbot_workstation.gap_report.driving_section import driving_section
from mbot_workstation.gap_report.elements import figure, paragraph, table
from mbot_workstation.gap_report.error_plot import error_plot
from mbot_workstation.gap_report.number_words import degrees, metres, percent, seconds
from mbot_workstation.gap_report.page_style import STYLE
from mbot_workstation.gap_report.parameter_section import parameter_section
from mbot_workstation.gap_report.path_error import path_error
from mbot_workstation.gap_report.path_plot import path_plot
from mbot_workstation.gap_report.summary_section import summary_section
from mbot_workstation.gap_report.verdict_section import verdict_section
from mbot_workstation.recordings.maneuver import MANEUVERS
from mbot_workstation.simulation.parameter_table import PARAMETERS

from .calibrations import CAMERA, MOTION
from .gap_samples import CalibrationFiles, compared_runs, report, tolerances

FILES = CalibrationFiles("calibration/mbot-1", CAMERA, MOTION)


def test_numbers_have_the_digits_and_units_of_their_size() -> None:
    assert [metres(value) for value in (0.0042, 0.032, 1.314)] == ["4.2 mm", "3.2 cm", "1.31 m"]
    assert [degrees(math.radians(value)) for value in (0.84, 123.4)] == ["0.8°", "123°"]
    assert [percent(share) for share in (0.0031, 0.024, 0.12, None)] == [
        "0.31 %",
        "2.4 %",
        "12 %",
        "not known",
    ]
    assert seconds(10.0) == "10 s"


def test_text_in_html_is_escaped() -> None:
    for html in (paragraph("a < b"), table(["a < b"], [["a < b"]]), figure("", "a < b")):
        assert "a &lt; b" in html
        assert "a < b" not in html
    assert table(["name", "value"], [["x", "1"]], numbers=1).count('class="number"') == 2


def test_errors_are_those_of_each_moment() -> None:
    runs = compared_runs(MANEUVERS[:1], 3, offset=(0.03, -0.04, 0.1))
    found = path_error(runs, CALIBRATED)
    assert found.position_at_end_m == pytest.approx([0.05] * 3)
    assert found.yaw_at_end_rad == pytest.approx([0.1] * 3)
    assert path_error(runs, NOMINAL).position_at_end_m.min() > 0.05


def test_a_line_through_noise_bridges_gaps() -> None:
    seen_s = np.concatenate([np.arange(0, 1, 0.01), np.arange(1.5, 2, 0.01)])
    rng = np.random.default_rng(0)
    found = line_at(
        seen_s, 0.4 * seen_s + rng.normal(0, 0.004, seen_s.size), np.arange(0.1, 1.9, 0.1)
    )
    np.testing.assert_allclose(found, 0.4 * np.arange(0.1, 1.9, 0.1), atol=0.01)


def test_plots_are_pictures_with_words() -> None:
    runs = compared_runs(MANEUVERS[:1], 2)
    errors = [path_error(runs, name) for name in (CALIBRATED, NOMINAL)]
    for svg in (path_plot(MANEUVERS[0].name, runs), error_plot(MANEUVERS[0].name, *errors)):
        assert "<svg" in svg
        assert MANEUVERS[0].name in svg


def test_the_summary_leads_with_speed_and_turn_rate() -> None:
    found = report(compared_runs(), FILES, tolerances())
    text = summary_section(found)
    assert text.index("At speed the simulated robot is off by") < text.index(
        "of driving on the same"
    )
    assert text.index("Steady speed") < text.index("Position after")
    unknown = replace(found, files=replace_motion(None))
    assert "Its motors have not been identified yet" in summary_section(unknown)


def test_every_parameter_of_the_table_is_shown() -> None:
    text = parameter_section(FILES)
    for one in PARAMETERS:
        if one.name != "mass_ahead_m":  # left to the body here
            assert one.words.replace("'", "&#x27;") in text
    assert "None yet" in parameter_section(replace_motion(None))


def test_sections_have_headings_and_no_code() -> None:
    found = report(compared_runs(), FILES, tolerances())
    for section in (driving_section, camera_section, verdict_section):
        text = section(found)
        assert "<h2>" in text
        assert "<script" not in text
    assert "<" not in STYLE


def replace_motion(motion: None) -> CalibrationFiles:
    return CalibrationFiles("calibration/mbot-1", CAMERA, motion)
