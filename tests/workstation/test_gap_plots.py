"""The page's charts: `gap_report.plots`."""

import base64
from xml.etree import ElementTree

import numpy as np
from matplotlib.figure import Figure

from mbot_workstation.learn.studies.tolerance_file import MapAxis
from mbot_workstation.measure.gap_report.plots import (
    axis_words,
    error_plot,
    path_plot,
    rates_plot,
    to_uri,
    tolerance_plot,
)
from mbot_workstation.measure.gap_report.quantities import quantities
from mbot_workstation.measure.tracks.maneuver import MANEUVERS

from .calibrations import BODY, CAMERA, LIGHT, MOTION
from .gap_samples import CalibrationFiles, compared_runs, tolerances

FILES = CalibrationFiles("calibration/mbot-1", CAMERA, MOTION, BODY, LIGHT)


def drawn(uri: str) -> ElementTree.Element:
    """The picture in an address."""
    kind, _, data = uri.partition(",")
    assert kind == "data:image/svg+xml;base64"
    return ElementTree.fromstring(base64.b64decode(data))


def test_charts_are_whole_pictures() -> None:
    runs, maps = compared_runs(), tolerances()
    known = {one.deviation: one for one in quantities(FILES, runs)}
    line = Figure(figsize=(2, 1))
    line.subplots().plot([0, 1], [0, 1])
    charts = [
        to_uri(line),
        path_plot(runs[:1]),
        error_plot(runs[:1]),
        rates_plot({MANEUVERS[0].name: runs[:1]}),
        rates_plot({}),
        tolerance_plot(maps.maps[0], maps, {}),
        tolerance_plot(maps.maps[0], maps, known),
    ]
    for chart in charts:
        assert drawn(chart).tag.endswith("svg")
    assert len(set(charts)) == len(charts)
    assert path_plot(runs[:1]) == charts[1]


def test_axes_are_words_with_units() -> None:
    known = {one.deviation: one for one in quantities(FILES, ())}
    axes = {
        "track_scale": "Track off by (%)",
        "camera_latency_ms": "Latency off by (ms)",
        "camera_pitch_deg": "Mounting pitch off by (°)",
        "exposure_ms": "Exposure time (ms)",
    }
    for name, words in axes.items():
        assert axis_words(MapAxis(name, "ms", 0.0, (0.0, 1.0)), known) == words


def test_a_robot_beyond_a_map_is_drawn_at_its_end() -> None:
    runs, maps = compared_runs(true=(0.8, 0.38, 0.12)), tolerances()
    known = {one.deviation: one for one in quantities(FILES, runs)}
    assert np.isfinite(known["gain asymmetry"].uncalibrated or np.nan)
    assert drawn(tolerance_plot(maps.maps[0], maps, known)).tag.endswith("svg")
