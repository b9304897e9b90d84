"""What scripts get by --json: these keys stay, whatever becomes of the structs behind them."""

import dataclasses
from typing import Any

import pytest

from mbot_workstation.cli.calibrate import RoomAnswer
from mbot_workstation.cli.collect import CollectedDrive
from mbot_workstation.cli.drives import Report, ReportedDrive
from mbot_workstation.cli.driving import FaultFound, RunOutcome
from mbot_workstation.cli.evaluate import Explanation
from mbot_workstation.cli.keys import KeyHere, KeyPair
from mbot_workstation.cli.maneuvers import ListedManeuver
from mbot_workstation.cli.models import Examined
from mbot_workstation.cli.objects import ObjectsDrawn, ObjectThere
from mbot_workstation.cli.recordings import DriveThere, FilledRecording
from mbot_workstation.cli.robot import RobotWritten
from mbot_workstation.cli.set_up import UpdateOutcome
from mbot_workstation.fleet.enrolment.membership import HandOver
from mbot_workstation.fleet.enrolment.roll import EnrolledRobot, Roll
from mbot_workstation.fleet.link.fleet import Found, Motor, RobotReport
from mbot_workstation.fleet.models.model_findings import ModelFinding
from mbot_workstation.fleet.models.stored_models import StoredModel
from mbot_workstation.fleet.models.written_policy import WrittenPolicy
from mbot_workstation.learn.evaluation.episodes import EpisodeResult, score
from mbot_workstation.learn.evaluation.evaluation_report import Line
from mbot_workstation.learn.evaluation.evaluation_report import fields as line_fields
from mbot_workstation.learn.evaluation.promotion import Compared, Promotion
from mbot_workstation.learn.evaluation.trim_trial import TrimTrial
from mbot_workstation.learn.learning.training_run import TrainingResult
from mbot_workstation.look.demo.demo_result import DemoResult
from mbot_workstation.look.drives.replay_words import DifferentDecision, ReplayAnswer
from mbot_workstation.measure.calibration.body.body_check import Finding
from mbot_workstation.measure.calibration.body.mass_properties import MassProperties
from mbot_workstation.measure.calibration.camera.camera_result import CameraResult, FittedPicture
from mbot_workstation.measure.calibration.light.light_result import CardPhotograph, LightResult
from mbot_workstation.measure.gap_report.answer import (
    EndErrors,
    GapAnswer,
    ManeuverAnswer,
    VerdictAnswer,
)
from mbot_workstation.measure.identification.result_words import FitAnswer, FittedParameter
from mbot_workstation.measure.rehearsal.outcome import ComparedQuantity
from mbot_workstation.tasks.fetch.task import TASK

KEYS: dict[type, str] = {
    CameraResult: "camera standard_deviations reprojection_error_px limit_px pictures "
    "without_board empty_areas poses tilt_deg objections notes path",
    CardPhotograph: "name rgb turned delta_e_before delta_e_after",
    CollectedDrive: "path sentence verdict part labels marks by_hand_s",
    Compared: "by name count before after gain",
    ComparedQuantity: "what truth nominal found relative nominal_error found_error",
    DemoResult: "touches driven_s distance_driven_m score decisions missed_ticks decision_p50_ms "
    "decision_p99_ms frame_p50_ms frame_p99_ms agent_cpu_share agent_memory_mb push_s "
    "board_version board_has_deadman success",
    DifferentDecision: "sequence since_s then now difference failure by_hand",
    DriveThere: "name started_unix_time_ns ended_unix_time_ns size_bytes files kept open",
    EndErrors: "at_s position_m yaw_deg",
    EnrolledRobot: "hosts port expires people router keys",
    Examined: "model accepted findings",
    Explanation: "path actions actions_without_memory",
    FaultFound: "kind detail",
    FilledRecording: "output beats filled_beats filled_pictures still_missing",
    Finding: "verdict text",
    FitAnswer: "robot runs_fitted runs_held_out left_out parameters latency_s steady misfit "
    "uneven_motors scatter clock_drift tracker_ahead_left_yaw held_out repeatability written "
    "trim_trial",
    FittedParameter: "value before low high undetermined",
    FittedPicture: "name width_px height_px corners distance_m tilt_deg error_px kept",
    Found: "kind detail",
    GapAnswer: "robot_id made_on recordings recorded_runs held_out_runs left_out after_s "
    "turned_deg calibrated nominal not_helped maneuvers reprojection_error_px gray_card_delta_e "
    "verdicts frames missing path",
    HandOver: "kind name file host",
    RoomAnswer: "pitch_deg roll_deg upright_edges width_px height_px notes path preview",
    KeyHere: "name line protected",
    KeyPair: "name line private_key",
    LightResult: "exposure_gain red_gain blue_gain direction direction_known_to_deg ambient "
    "undetermined delta_e_before delta_e_after photographs notes path",
    ListedManeuver: "name left right length_m width_m",
    ManeuverAnswer: "repetitions calibrated nominal rates",
    MassProperties: "mass_kg mass_uncertainty_kg centre_m centre_uncertainty_m inertia_kg_m2",
    ModelFinding: "subject verdict detail",
    Motor: "reversed trim dead_band",
    ObjectsDrawn: "path objects",
    ObjectThere: "name shape width_m height_m",
    Promotion: "model against passed objections compared",
    ReplayAnswer: "recording model_sha256 same_model same_processor decisions exact "
    "same_motor_bytes largest_difference mean_difference left_out other_views as_expected "
    "differing",
    Report: "path drives",
    ReportedDrive: "recording sentence models decisions missed_beats lost_records faults",
    RobotReport: "address robot_id state hand_let_go faults notices accepts_unsigned_models "
    "trusted_keys model_sha256 model_name model_signed_by decision_rate_hz decisions missed_ticks "
    "board_version board_has_deadman left_motor right_motor camera software_version release error",
    RobotWritten: "folder files free_speed_rpm",
    Roll: "schema me people robots routers revoked",
    RunOutcome: "robot_id state faults",
    StoredModel: "sha256 name size_bytes decision_rate_hz stored_unix_time_ns active previous "
    "signed_by proven rejected",
    TrainingResult: "run step wall_s lesson mean_reward reason",
    TrimTrial: "policy episodes trimmed alone chosen",
    UpdateOutcome: "robot_id version outcome detail",
    VerdictAnswer: "quantity deviation tolerated uncalibrated calibrated source",
    WrittenPolicy: "path name sha256 size_bytes checkpoint",
}


@pytest.mark.parametrize("kind", KEYS, ids=lambda kind: kind.__name__)
def test_a_script_finds_the_keys_that_it_knows(kind: Any) -> None:
    of_a_struct = getattr(kind, "__struct_encode_fields__", None)
    found = of_a_struct or [field.name for field in dataclasses.fields(kind)]
    assert set(found) == set(KEYS[kind].split())


def test_a_score_is_told_in_its_tasks_words() -> None:
    line = Line("servo", "nominal", score([EpisodeResult(3.0, 20, 1, completed=True)]))
    assert " ".join(line_fields(line, [line], TASK)) == (
        "contestant preset episodes reward touches success length decisions_per_object "
        "share_of_oracle"
    )
