from pathlib import Path

import cv2
import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.commands.study import NAMES, TOLERANCE, study
from mbot_workstation.training.evaluate import EpisodeResult, Trial, score
from mbot_workstation.training.evaluation_report import Line
from mbot_workstation.training.lessons import lesson
from mbot_workstation.training.presets import NOMINAL
from mbot_workstation.training.study import run_study
from mbot_workstation.training.study_plans import DEVIATIONS, PAIRS, STUDIES, deviating
from mbot_workstation.training.tolerance_map import ToleranceMap


def invoke(*arguments: str) -> str:
    app = typer.Typer()
    app.command()(study)
    result = CliRunner().invoke(app, list(arguments), catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def test_the_command_knows_all_studies() -> None:
    assert set(NAMES) == {*STUDIES, TOLERANCE}


def test_nominal_values_of_deviations_are_the_nominal_robot() -> None:
    nominal = deviating({name: deviation.nominal for name, deviation in DEVIATIONS.items()})
    assert nominal == NOMINAL
    assert {name for pair in PAIRS for name in pair} <= set(DEVIATIONS)
    for name, deviation in DEVIATIONS.items():
        for value in (deviation.low, deviation.high):
            assert deviating({name: value}) != NOMINAL


def test_latency_is_counted_from_picture_to_wheels() -> None:
    for condition in STUDIES["latency"].conditions:
        effects = condition.effects.low
        assert effects.camera_latency_ms == condition.value
        assert effects.action_latency_ms + effects.action_jitter_ms + effects.frame_interval_ms == 0


def test_a_map_goes_row_by_row_from_the_lowest() -> None:
    grid = ToleranceMap.of("track_scale", "exposure_ms", 3)
    conditions = grid.conditions()
    assert [condition.effects.low.track_scale for condition in conditions[:3]] == [0.7, 1.0, 1.3]
    assert [condition.effects.low.exposure_ms for condition in conditions[::3]] == [0, 30, 60]
    lines = [
        Line("x", condition.label, score([EpisodeResult(float(n), 1, 1, True)]))
        for n, condition in enumerate(conditions)
    ]
    np.testing.assert_array_equal(grid.rewards(lines), np.arange(9).reshape(3, 3))


def test_a_study_becomes_a_page_and_a_picture(tmp_path: Path) -> None:
    options = ["oracle", "--lesson", "1", "--episodes", "1", "-o", str(tmp_path)]
    assert invoke("handicap", *options) == f"wrote {tmp_path / 'handicap.md'}\n"
    page = (tmp_path / "handicap.md").read_text()
    for condition in STUDIES["handicap"].conditions:
        assert f"| {condition.label} | oracle |" in page
    assert cv2.imread(str(tmp_path / "handicap.png")) is not None
    invoke(TOLERANCE, *options, "--pair", "track_scale:fov_scale", "--cells", "2")
    page = (tmp_path / "tolerance.md").read_text()
    assert "## track_scale and fov_scale" in page
    assert "| **1.3** |" in page
    assert cv2.imread(str(tmp_path / "tolerance.png")) is not None


def test_what_cannot_be_studied_is_named(tmp_path: Path) -> None:
    for arguments, message in (
        (("weather", "servo"), "no study"),
        (("blur", "servo", "--lesson", "x"), "--lesson"),
        (("blur", "servo", "--backend", "magic"), "no back end"),
        (("tolerance", "servo", "--pair", "track_scale"), "--pair"),
        (("tolerance", "servo", "--pair", "a:b"), "no deviation 'a'"),
    ):
        with pytest.raises(ConfigurationError, match=message):
            invoke(*arguments, "-o", str(tmp_path))
    trial = Trial(lesson("1"), NOMINAL, [], 1)
    with pytest.raises(ConfigurationError, match="needs the package 'ray'"):
        run_study([], [], trial, backend="ray")
