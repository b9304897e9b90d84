import re
from io import StringIO
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest
from rich.console import Console

from mbot_protocol.errors import ConfigurationError, MbotError
from mbot_workstation.measure.calibration.camera.board_detection import find_board
from mbot_workstation.measure.calibration.light.light_measurement import CardSettings, measure_light
from mbot_workstation.measure.gap_report.frames import read_frames
from mbot_workstation.measure.rehearsal.afternoon import TRUTH_FOLDER
from mbot_workstation.measure.rehearsal.command_line import CommandLine
from mbot_workstation.measure.rehearsal.driving import (
    ROBOT_ID,
    drive_session,
    leave_out_spoilt,
    robot_pair,
)
from mbot_workstation.measure.rehearsal.outcome import as_table, outcome, outcome_answer
from mbot_workstation.measure.rehearsal.photographs import (
    CARD_MM,
    PLACES,
    REFLECTANCE,
    TURNS_DEG,
    board_photos,
    card_photos,
    take_frames,
)
from mbot_workstation.measure.rehearsal.truth import (
    MOTION,
    TRUTH,
    WORN_MOTION,
    corrected,
    write_truth,
)
from mbot_workstation.measure.targets.specifications import Board
from mbot_workstation.measure.tracks.commands_csv import read_commands
from mbot_workstation.measure.tracks.maneuver import MANEUVERS
from mbot_workstation.measure.tracks.recording_folder import read_maneuvers, write_maneuvers
from mbot_workstation.measure.tracks.recording_toml import read_info
from mbot_workstation.measure.tracks.run import Run
from mbot_workstation.measure.tracks.track_file import read_track
from mbot_workstation.measure.tracks.track_format import PRESETS
from mbot_workstation.pictures.picture_file import write_picture
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.calibrated.calibration_folder import (
    CalibrationFiles,
    read_calibration,
    read_files,
)

from .driven_robot import session


@pytest.fixture
def line(tmp_path: Path) -> CommandLine:
    return CommandLine(tmp_path, Console(file=StringIO(), width=200))


def shown(line: CommandLine) -> str:
    file = line.console.file
    assert isinstance(file, StringIO)
    return file.getvalue()


def test_the_truth_is_a_calibration_that_differs_from_nominal_in_everything(tmp_path: Path) -> None:
    write_truth(tmp_path)
    true, nominal = read_calibration(tmp_path), RobotParameters()
    robot = true.robot
    assert (robot, true.scene) == (TRUTH.robot, TRUTH.scene)
    assert robot.left_motor.gain != robot.right_motor.gain
    for name in ("track_m", "wheel_radius_m", "mass_kg", "camera", "camera_mount", "left_motor"):
        assert getattr(robot, name) != getattr(nominal, name)
    assert true.scene.light != CalibrationFiles().scene.light
    assert true.effects.action_latency_ms != CalibrationFiles().effects.action_latency_ms
    assert len(true.rooms) == 1


def test_photographs_of_the_board_show_corners_where_the_true_lens_puts_them() -> None:
    camera = TRUTH.robot.camera.scaled_to(1014, 760)
    (picture,) = board_photos(camera, 1, seed=3)
    assert picture.shape == (760, 1014, 3)
    grey = np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), np.uint8)
    found = find_board(grey, Board())
    assert found is not None
    assert found.mirrored is False
    points, pixels = found.points_m, found.corners_px
    matrix, distortion = camera.matrix, np.array(camera.distortion)
    done, turn, place = cv2.solvePnP(points, pixels, matrix, distortion)
    assert done
    again, _ = cv2.projectPoints(points, turn, place, matrix, distortion)
    away = np.linalg.norm(np.asarray(again).reshape(-1, 2) - pixels, axis=1)
    assert np.sqrt((away**2).mean()) < 0.1
    # Without its distortion the same lens does not explain the picture.
    straight = np.zeros(5)
    _, turn, place = cv2.solvePnP(points, pixels, matrix, straight)
    again, _ = cv2.projectPoints(points, turn, place, matrix, straight)
    bent = np.linalg.norm(np.asarray(again).reshape(-1, 2) - pixels, axis=1)
    assert np.sqrt((bent**2).mean()) > 3 * np.sqrt((away**2).mean())


@pytest.mark.slow
def test_photographs_of_the_gray_card_tell_the_true_light(tmp_path: Path) -> None:
    paths = [tmp_path / f"{number}.png" for number in range(len(TURNS_DEG))]
    for path, picture in zip(paths, card_photos(TRUTH, seed=1), strict=True):
        write_picture(path, picture)
    found = measure_light(paths, TRUTH.robot, CardSettings(CARD_MM, REFLECTANCE))
    light, true = found.fit.light, TRUTH.scene.light
    assert found.fit.undetermined is None
    way, truly = np.array(light.direction), np.array(true.direction)
    cosine = way @ truly / np.linalg.norm(way) / np.linalg.norm(truly)
    assert np.degrees(np.arccos(cosine)) < 3
    assert found.fit.exposure_gain == pytest.approx(TRUTH.effects.exposure_gain, rel=0.02)
    assert found.fit.red_gain == pytest.approx(TRUTH.effects.red_gain, rel=0.02)
    assert light.ambient == pytest.approx(true.ambient, abs=0.03)


def test_frames_come_with_their_places(tmp_path: Path) -> None:
    take_frames(tmp_path, TRUTH, seed=1)
    frames = read_frames(tmp_path)
    for frame, place in zip(frames, PLACES, strict=True):
        assert frame.place.robot.x_m == pytest.approx(place.robot.x_m)
        assert frame.place.robot.yaw_rad == pytest.approx(place.robot.yaw_rad, abs=1e-4)
        assert (frame.place.cube is None) == (place.cube is None)
        red = frame.picture.astype(int)
        has_cube = bool((red[..., 0] - red[..., 1] > 60).sum() > 200)
        assert has_cube == (place.cube is not None)


def test_the_outcome_compares_with_the_truth() -> None:
    perfect = outcome(TRUTH, TRUTH)
    assert all(abs(row.error(row.found) or 0.0) < 1e-9 for row in perfect)
    assert all(abs(row.error(row.nominal) or 0.0) > 1e-3 for row in perfect)
    only_lens = outcome(TRUTH, CalibrationFiles(camera=TRUTH.camera))
    told = {row.what for row in only_lens if row.found is not None}
    assert told == {row.what for row in perfect if "px" in row.what or "distortion" in row.what}
    assert as_table(only_lens).row_count == len(perfect)
    assert outcome_answer(only_lens)[0].found is None


@pytest.mark.slow
def test_commands_are_shown_as_they_are_typed(line: CommandLine) -> None:
    line.run("workstation", "calibrate", "body", "--example", to="components.toml")
    assert "$ workstation calibrate body --example > components.toml" in shown(line)
    line.run("workstation", "calibrate", "body", "components.toml", "--calibration", "cal")
    assert "wrote cal/body.toml" in shown(line)
    assert read_files(line.folder / "cal").body is not None
    assert len(list((line.folder / "log").iterdir())) == 2


def test_a_command_that_fails_ends_the_rehearsal_with_its_last_words(line: CommandLine) -> None:
    with pytest.raises(MbotError, match=r"exit code 2: workstation: .*missing\.toml"):
        line.run("workstation", "calibrate", "body", "missing.toml")


def with_hole(run: Run) -> Run:
    since_s = run.track.time_s - run.track.time_s[0]
    track = run.track.where((since_s < 2) | (since_s > 3))
    return Run(run.number, run.maneuver, run.repetition, run.commands, track)


def test_runs_without_a_whole_track_are_left_out(tmp_path: Path) -> None:
    runs = list(session(repetitions=1, duration_s=3.0))
    runs[3] = with_hole(runs[3])
    write_maneuvers(tmp_path, "mbot-1", runs)
    assert leave_out_spoilt(tmp_path) == (4,)
    assert read_info(tmp_path).leave_out == (4,)
    assert len(read_maneuvers(tmp_path).runs) == 7


def test_too_many_holes_are_no_rehearsal(tmp_path: Path) -> None:
    runs = [with_hole(run) for run in session(None, 1, 3.0, MANEUVERS[:4])]
    runs[0] = session(None, 1, 3.0, MANEUVERS[:1])[0]
    write_maneuvers(tmp_path, "mbot-1", runs)
    with pytest.raises(ConfigurationError, match="too busy"):
        leave_out_spoilt(tmp_path)


class FailingLine(CommandLine):
    """Records nothing, so many times."""

    def __init__(self, folder: Path, failures: int) -> None:
        super().__init__(folder, Console(file=StringIO(), width=200))
        self.failures = failures
        self.typed: list[tuple[str, ...]] = []

    def run(self, *words: str, to: str | None = None, quiet: bool = False) -> float:
        self.typed.append(words)
        if len(self.typed) <= self.failures:
            raise MbotError("`workstation maneuvers run` failed", said="link lost")
        return 1.0


def test_a_spoilt_session_is_resumed(tmp_path: Path) -> None:
    recording = tmp_path / "recording"
    write_maneuvers(recording, "mbot-1", session(None, 1, 2.0, MANEUVERS[:1]))
    line = FailingLine(tmp_path, failures=2)
    drive_session(line, "recording", "--yes")
    assert [words[-2:] for words in line.typed] == [
        ("--output", "recording"),
        ("--resume", "recording"),
        ("--resume", "recording"),
    ]
    assert "a run was spoilt (link lost)" in shown(line)


def test_a_daemon_that_corrects_drives_the_same_motors() -> None:
    found = msgspec.structs.replace(
        MOTION,
        left_motor=msgspec.structs.replace(MOTION.left_motor, gain=0.9, trim=0.8),
        right_motor=msgspec.structs.replace(MOTION.right_motor, dead_band_compensation=33),
    )
    driven = corrected(WORN_MOTION, found)
    assert driven.wheel_maps() == found.wheel_maps()
    assert driven.left_motor.gain == WORN_MOTION.left_motor.gain
    assert driven.right_motor.backward_share == WORN_MOTION.right_motor.backward_share


def test_a_session_that_never_gets_on_ends(tmp_path: Path) -> None:
    line = FailingLine(tmp_path, failures=99)
    with pytest.raises(MbotError) as caught:
        drive_session(line, "recording", "--yes")
    assert (caught.value.facts, len(line.typed)) == ({"said": "link lost"}, 3)


@pytest.mark.slow
def test_the_true_robot_is_driven_by_the_real_daemon(line: CommandLine) -> None:
    truth = line.folder / TRUTH_FOLDER
    write_truth(truth)
    (line.folder / "log").mkdir()
    with robot_pair(line, truth, "track.csv") as address:
        line.run(
            *("workstation", "maneuvers", "run", "--robot", address, "--yes", "--pause", "0"),
            *("--seconds", "1.5", "--repetitions", "2", "--maneuver", "backward-forward"),
            *("--output", "recording"),
        )
    runs = read_commands(line.folder / "recording" / "commands.csv")
    assert [run.maneuver for run in runs] == ["backward-forward"] * 2
    assert read_info(line.folder / "recording").robot_id == ROBOT_ID
    track = read_track(line.folder / "track.csv", PRESETS["triad-openvr"])
    assert track.yaw_rad.max() > 3  # to the left, at 6 rad/s for 1.5 s
    text = shown(line)
    assert re.search(r"\$ workstation virtual-robot .* &", text)
    assert "$ mbot-agent run --config robot.toml &" in text
