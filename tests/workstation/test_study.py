from collections.abc import Sequence
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.evaluate import NAMES, TOLERANCE, _beside, study  # pyright: ignore[reportPrivateUsage]
from mbot_workstation.learn.evaluation.episodes import EpisodeResult, Trial, score
from mbot_workstation.learn.evaluation.evaluation_report import Line
from mbot_workstation.learn.studies.study_plans import (
    DEVIATIONS,
    PAIRS,
    STUDIES,
    deviating,
    study_plan,
)
from mbot_workstation.learn.studies.study_run import Condition, run_study
from mbot_workstation.learn.studies.tolerance_file import read_tolerances
from mbot_workstation.learn.studies.tolerance_map import ToleranceMap
from mbot_workstation.learn.studies.tolerance_study import map_tolerances, pairs_named
from mbot_workstation.sim.calibrated.calibration_folder import (
    CalibrationFiles,
    read_files,
    write_motion,
)
from mbot_workstation.sim.effects.perturbed_robot import perturbed_robot
from mbot_workstation.sim.effects.presets import NOMINAL, preset
from mbot_workstation.tasks.fetch.task import TASK
from mbot_workstation.tasks.lesson import lesson_named

from .calibrations import LIGHT, MOTION
from .called import output_of

invoke = partial(output_of, study)


def test_results_go_beside_the_first_policy_and_never_into_the_documents(tmp_path: Path) -> None:
    (tmp_path / "policy.onnx").touch()
    assert _beside(["servo", str(tmp_path / "policy.onnx")]) == tmp_path / "studies"
    assert _beside(["servo", "oracle"]) == Path("studies")


def test_the_command_knows_all_studies() -> None:
    assert set(NAMES) == {*STUDIES, TOLERANCE}


def test_nominal_values_of_deviations_are_the_nominal_robot() -> None:
    nominal = deviating({name: deviation.nominal for name, deviation in DEVIATIONS.items()})
    assert nominal == NOMINAL
    assert {name for pair in PAIRS for name in pair} <= set(DEVIATIONS)
    for name, deviation in DEVIATIONS.items():
        for value in (deviation.low, deviation.high):
            assert deviating({name: value}) != NOMINAL


def test_a_map_of_tolerances_also_counts_mistakes_in_homes(tmp_path: Path) -> None:
    tried: list[str] = []

    def run(conditions: Sequence[Condition], drivers: Sequence[str]) -> list[Line]:
        tried.extend(one.label for one in conditions)
        results = [EpisodeResult(20.0, 10, 10, True, {"wrong_things": n}) for n in (1, 3)]
        return [Line(drivers[0], one.label, score(results)) for one in conditions]

    trial = Trial(lesson_named(TASK.lessons, "10"), NOMINAL, [], 2)
    maps = [ToleranceMap.of("track_scale", "exposure_gain", 2)]
    numbers, page = map_tolerances("mine", maps, trial, run, tmp_path, "how", preset("home"))
    (found,) = read_tolerances(numbers).mistakes
    assert (found.name, found.mean, found.episodes) == ("wrong_things", 2.0, 2)
    assert found.words in page.read_text()
    assert tried.count("homes") == 1
    map_tolerances("mine", maps, trial, run, tmp_path / "without", "how")
    assert tried.count("homes") == 1


def test_latency_is_counted_from_picture_to_wheels() -> None:
    for condition in study_plan("latency").conditions:
        effects = condition.effects.low
        assert effects.camera_latency_ms == condition.value
        assert effects.action_latency_ms + effects.action_jitter_ms + effects.frame_interval_ms == 0


def test_pairs_are_two_deviations_each() -> None:
    assert len(pairs_named((), 3)) == len(PAIRS)
    (one,) = pairs_named(["track_scale:exposure_ms"], 3)
    assert (one.across, one.up) == ("track_scale", "exposure_ms")
    with pytest.raises(ConfigurationError):
        pairs_named(["track_scale"], 3)


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


@pytest.mark.slow
def test_a_study_becomes_a_page_and_a_picture(tmp_path: Path) -> None:
    options = ["oracle", "--lesson", "1", "--episodes", "1", "-o", str(tmp_path)]
    assert invoke("handicap", *options) == f"wrote {tmp_path / 'handicap.md'}\n"
    page = (tmp_path / "handicap.md").read_text()
    for condition in study_plan("handicap").conditions:
        assert f"| {condition.label} | oracle |" in page
    assert cv2.imread(str(tmp_path / "handicap.png")) is not None
    invoke(TOLERANCE, *options, "--pair", "track_scale:fov_scale", "--cells", "2")
    page = (tmp_path / "tolerance.md").read_text()
    assert "## Track and field of view" in page
    assert "| **1.3** |" in page
    assert cv2.imread(str(tmp_path / "tolerance.png")) is not None


def test_studies_are_made_around_a_calibrated_robot(tmp_path: Path) -> None:
    files = CalibrationFiles(motion=MOTION, light=LIGHT)

    def gains(condition: Condition) -> tuple[float, float]:
        robot = perturbed_robot(files.robot, condition.effects.low)
        return robot.left_motor.gain, robot.right_motor.gain

    left, right = study_plan("handicap", files.ranges).conditions[1:]
    assert gains(left) == (1.06 / 2, 0.94)
    assert gains(right) == (1.06, 0.94 / 2)
    for condition in study_plan("latency", files.ranges).conditions:
        assert condition.effects.low.camera_latency_ms == condition.value
        assert condition.effects.low.action_latency_ms == 0
        assert gains(condition) == (1.06, 0.94)
    uneven, *_ = (c for c in study_plan("robots", files.ranges).conditions if c.label == "uneven")
    assert uneven.effects == files.ranges("uneven")
    robot = files.ranges("nominal")
    nominal = {name: deviation.nominal for name, deviation in DEVIATIONS.items()}
    assert deviating(nominal, robot) == robot
    (cell, *_) = ToleranceMap.of("exposure_gain", "fov_scale", 3).conditions(robot)
    assert cell.effects.low.exposure_gain == pytest.approx(0.4 * 0.8)


def test_the_command_tries_the_calibrated_robot_in_its_rooms(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "mbot-1"
    write_motion(folder, MOTION)
    (folder / "rooms").mkdir()
    cv2.imwrite(str(folder / "rooms" / "kitchen.png"), np.full((64, 128, 3), 90, np.uint8))
    tried: list[Trial] = []

    def evaluate(contestant: str, trial: Trial, *_: object) -> list[EpisodeResult]:
        tried.append(trial)
        return [EpisodeResult(1.0, 1, 1, completed=True)]

    monkeypatch.setattr("mbot_workstation.learn.studies.study_run.evaluate", evaluate)
    options = ["--calibration", str(folder), "-o", str(tmp_path)]
    invoke("handicap", "oracle", *options)
    invoke(TOLERANCE, "oracle", *options, "--pair", "track_scale:fov_scale", "--cells", "2")
    robot = read_files(folder).robot
    assert all(trial.robot == robot and len(trial.rooms) == 1 for trial in tried)
    assert {trial.preset.low.right_gain for trial in tried} == {1.0, 0.5}
    for page in ("handicap.md", "tolerance.md"):
        text = (tmp_path / page).read_text()
        assert f"Nominal here is the robot of {folder}." in text
        assert "1 photographed rooms, seed 0" in text


@pytest.mark.slow
def test_what_cannot_be_studied_is_named(tmp_path: Path) -> None:
    for arguments, message in (
        (("weather", "servo"), "no study"),
        (("blur", "servo", str(tmp_path / "none.onnx")), "no policy"),
        (("blur", "servo", "--lesson", "x"), "--lesson"),
        (("blur", "servo", "--backend", "magic"), "no back end"),
        (("tolerance", "servo", "--pair", "track_scale"), "--pair"),
        (("tolerance", "servo", "--pair", "a:b"), "no deviation 'a'"),
    ):
        with pytest.raises(ConfigurationError, match=message):
            invoke(*arguments, "-o", str(tmp_path))
    trial = Trial(lesson_named(TASK.lessons, "1"), NOMINAL, [], 1)
    with pytest.raises(ConfigurationError, match="needs the package 'ray'"):
        run_study([], [], trial, backend="ray")
