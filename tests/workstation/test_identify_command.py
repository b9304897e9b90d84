import json
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.testing import Result

from mbot_protocol.errors import ConfigurationError, MbotError
from mbot_workstation.cli.identify import identify
from mbot_workstation.learn.evaluation import trim_trial
from mbot_workstation.learn.evaluation.episodes import Estimate, Trial
from mbot_workstation.measure.identification.fit import identify as real_identify
from mbot_workstation.measure.identification.result import Identification
from mbot_workstation.measure.tracks.recording_folder import write_maneuvers
from mbot_workstation.measure.tracks.run import ManeuverRecording
from mbot_workstation.measure.tracks.track import Track
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.calibrated.calibration_folder import (
    CalibrationFiles,
    read_calibration,
)
from mbot_workstation.sim.calibrated.motion_calibration import (
    MotionCalibration,
    MotorCalibration,
    read_motion,
)

from .called import called
from .mujoco_truth import record_simulated
from .planar_robot import PlanarRobot, Session, Tracker, record

pytestmark = pytest.mark.xdist_group("identify")
"""Most tests look at the same fit."""

NAMES = ("forward-forward", "forward-neutral", "neutral-forward", "backward-forward")


def session() -> Session:
    short = Session().shortened(2.5, 2)
    return replace(short, schedules={name: short.schedules[name] for name in NAMES})


def write(recording: ManeuverRecording, folder: Path, robot_id: str = "planar-1") -> Path:
    tracks = [run.track for run in recording.runs]
    whole = Track(
        np.concatenate([track.time_s for track in tracks]),
        np.concatenate([track.position_m for track in tracks]),
        np.concatenate([track.quaternion_wxyz for track in tracks]),
    )
    write_maneuvers(
        folder,
        robot_id,
        recording.runs,
        wheel_maps=recording.wheel_maps,
        session_track=whole,
        made_on="2026-11-21",
    )
    return folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("recordings") / "planar"
    calm = Tracker(lost=0.01, gaps=0.0)
    return write(record(PlanarRobot(), session(), calm, seed=3), made)


@dataclass(frozen=True)
class First:
    """What the command said and wrote in a folder, and the fit behind it: the only one here."""

    result: Result
    where: Path
    found: Identification


@pytest.fixture(scope="module")
def first(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> First:
    where, kept = tmp_path_factory.mktemp("first"), list[Identification]()

    def keep(*arguments: Any, **named: Any) -> Identification:
        kept.append(real_identify(*arguments, **named))
        return kept[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(where)
        patch.setattr("mbot_workstation.measure.identification.fit.identify", keep)
        result = invoke(folder)
    (found,) = kept
    return First(result, where, found)


@pytest.fixture
def found(first: First) -> Identification:
    return replace(first.found, robot_id="mbot-7")


def answering(monkeypatch: pytest.MonkeyPatch, found: Identification) -> None:
    """Let the command take this for the fit's result: one fit is enough for several tests."""
    monkeypatch.setattr(
        "mbot_workstation.measure.identification.fit.identify", lambda *_, **__: found
    )


def invoke(*arguments: str | Path) -> Result:
    result = called(identify, *arguments)
    if isinstance(result.exception, MbotError):
        raise result.exception
    return result


@pytest.mark.slow
def test_a_recording_becomes_motion_toml(first: First) -> None:
    told, calibration = first.result, first.where / "calibration" / "planar-1"
    assert told.exit_code == 0, told.output
    assert "planar-1: fitted 8 runs, 4 held out" in told.output
    assert "left motor gain" in told.output
    assert "left dead band [of 255] stays 50: it changes nothing in these runs" in told.output
    assert "misses" in told.output
    tables = [line for line in told.output.splitlines() if line.startswith(NAMES)]
    assert len(tables) == 2 * len(NAMES)
    assert max(map(len, tables)) <= 80
    assert "the left motor is the stronger one: trim 0.9" in told.output
    assert f"wrote {Path('calibration/planar-1/motion.toml')}" in told.output
    motion = read_motion(calibration)
    assert motion is not None
    assert motion.track_m == pytest.approx(0.117, abs=0.004)
    assert motion.left_motor.trim < 1 == motion.right_motor.trim
    robot = read_calibration(calibration).robot
    assert robot.left_motor.gain == motion.left_motor.gain
    assert robot.inertia_scale == motion.inertia_scale != 1
    assert robot.centre_of_mass_m == motion.mass_ahead_m


@pytest.mark.slow
def test_json_holds_all_and_the_folder_is_where_it_is_told(
    folder: Path, found: Identification, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answering(monkeypatch, found)
    result = invoke(folder, "--calibration", tmp_path / "mine", "--json", "--robot", "mbot-7")
    told = json.loads(result.stdout)
    assert told["robot"] == "mbot-7"
    assert told["written"] == [str(tmp_path / "mine" / "motion.toml")]
    assert (told["runs_fitted"], told["runs_held_out"]) == (8, 4)
    gain = told["parameters"]["left_time_constant_s"]
    assert gain["low"] < gain["value"] < gain["high"]
    assert told["parameters"]["left_dead_band"]["undetermined"]
    assert told["latency_s"]["low"] is None
    straight, *others = told["held_out"]
    assert straight["after_m"] < straight["before_m"]
    assert sum(one["after_rad"] < one["before_rad"] for one in others) >= 2
    assert {one["maneuver"] for one in told["misfit"]} == set(NAMES)
    assert all(one["speed_sd"] > 0 for one in told["steady"])
    assert told["uneven_motors"]["straight"]["left"]["trim"] < 1


@pytest.mark.slow
def test_uneven_motors_can_be_left_to_the_policy(
    folder: Path, found: Identification, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answering(monkeypatch, found)
    assert "trim" in invoke(folder, "--calibration", tmp_path, "--no-trim").output
    motion = read_motion(tmp_path)
    assert motion is not None
    assert motion.left_motor.trim == motion.right_motor.trim == 1


def estimate(mean: float) -> Estimate:
    return Estimate(mean, mean - 0.1, mean + 0.1)


@pytest.mark.slow
@pytest.mark.parametrize(("trimmed", "alone"), [(19.0, 15.0), (15.0, 19.0), (17.0, 17.0)])
def test_where_a_trim_costs_speed_a_policy_may_judge_it(
    folder: Path,
    found: Identification,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    trimmed: float,
    alone: float,
) -> None:
    weak = replace(found.robot.right_motor, gain=found.robot.right_motor.gain / 2)
    answering(monkeypatch, replace(found, robot=replace(found.robot, right_motor=weak)))
    seen: list[float] = []

    def rewards(_policy: str, trial: Trial) -> float:
        seen.append(trial.robot.wheel_maps.left.trim)
        assert trial.robot.right_motor.gain == pytest.approx(weak.gain, rel=1e-4)
        return trimmed if seen[-1] < 1 else alone

    monkeypatch.setattr(trim_trial, "evaluate", rewards)
    monkeypatch.setattr(
        trim_trial, "score", lambda reward: SimpleNamespace(reward=estimate(reward))
    )
    told = invoke(folder, "--calibration", tmp_path, "--policy", "servo").output
    assert seen[0] < seen[1] == 1
    motion = read_motion(tmp_path)
    assert motion is not None
    assert (motion.left_motor.trim < 1) == (trimmed > alone)
    assert f"trimmed {trimmed:.2f}" in told
    assert ("trimmed is written" in told) == (trimmed > alone)


@pytest.mark.slow
def test_a_trim_that_costs_little_is_not_tried(
    folder: Path, found: Identification, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answering(monkeypatch, found)
    monkeypatch.setattr(trim_trial, "evaluate", lambda *_: pytest.fail("it was tried"))
    invoke(folder, "--calibration", tmp_path, "--policy", "servo")
    with pytest.raises(ConfigurationError, match="one of the two"):
        invoke(folder, "--no-trim", "--policy", "servo")
    with pytest.raises(MbotError, match="no-such"):
        invoke(folder, "--policy", "no-such.onnx")


@pytest.mark.slow
def test_a_policy_drives_the_robot_both_ways() -> None:
    """The servo never saw a weak motor: trimmed it gets there, alone it drives in circles."""
    weak = MotorCalibration(gain=0.5)

    def motion(trim: float) -> MotionCalibration:
        strong = MotorCalibration(gain=1.0, trim=trim)
        return MotionCalibration(
            left_motor=strong, right_motor=weak, latency_ms=15, made_on="2026-11-22"
        )

    trimmed, alone = motion(0.55), motion(1.0)
    tried = trim_trial.try_trim("servo", CalibrationFiles(), trimmed, alone, episodes=8)
    assert tried.trimmed.mean > tried.alone.mean + 1
    assert tried.chosen == "trimmed"


def test_recordings_of_two_robots_are_not_mixed(folder: Path, tmp_path: Path) -> None:
    other = write(record_simulated(RobotParameters(), session()), tmp_path / "other", "mbot-2")
    with pytest.raises(ConfigurationError, match="planar-1 and mbot-2; identify one robot"):
        invoke(folder, other)


@pytest.mark.slow
def test_a_fit_that_is_worse_than_nothing_is_not_written(
    folder: Path, found: Identification, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    errors = [replace(e, after_m=e.before_m + 1, after_rad=9.0) for e in found.errors]
    answering(monkeypatch, replace(found, errors=tuple(errors)))
    with pytest.raises(MbotError, match="further off than before, so nothing was written"):
        invoke(folder, "--calibration", tmp_path / "mine")
    assert not (tmp_path / "mine").exists()


def test_no_folder_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"recording\.toml"):
        invoke(tmp_path / "nothing")


@pytest.mark.slow
def test_the_documents_example_is_identified(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = Path(__file__).parents[2] / "docs" / "recordings.md"
    monkeypatch.chdir(tmp_path)
    exec(page.read_text().split("```python\n")[1].split("```")[0], {})
    found = invoke("ideal", "--calibration", tmp_path / "mine")
    assert found.exit_code == 0, found.output
    motion = read_motion(tmp_path / "mine")
    assert motion is not None
    assert motion.track_m == pytest.approx(0.115, abs=0.004)
