"""Charts of the gap report that the whole report only passes through."""

from pathlib import Path

import pytest
from matplotlib.figure import Figure

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.gap_report.building import Sources, build
from mbot_workstation.gap_report.rates_plot import rates_plot
from mbot_workstation.gap_report.svg import styled, to_svg
from mbot_workstation.gap_report.tolerance_plot import tolerance_plot

from .gap_samples import tolerances


def test_a_chart_is_an_element_with_ids_of_its_own() -> None:
    with styled():
        figure = Figure(figsize=(2, 1))
        figure.subplots().plot([0, 1], [0, 1])
    text = to_svg(figure, "first", "a line")
    assert text.startswith('<svg role="img" aria-label="a line"')
    assert 'id="first-' in text
    assert "xmlns" not in text


def test_a_map_says_what_its_axes_are() -> None:
    maps = tolerances()
    text = tolerance_plot(1, maps.maps[0], maps, {})
    assert text.startswith("<svg")
    assert "asymmetry" in text


def test_rates_of_no_runs_are_an_empty_chart() -> None:
    assert rates_plot([], []).startswith("<svg")


def test_a_recording_that_is_not_there_is_named(tmp_path: Path) -> None:
    sources = Sources((tmp_path / "missing",), None, None, None, "2026-11-22")
    with pytest.raises(ConfigurationError, match="missing"):
        build(sources)
