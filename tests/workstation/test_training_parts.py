"""Parts of training that the larger tests only pass through."""

import errno
import multiprocessing
import signal
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.learn.learning.git_state import git_state
from mbot_workstation.learn.learning.learning_curve import draw_curves, mark_note
from mbot_workstation.learn.learning.policy_source import find_source
from mbot_workstation.learn.learning.progress_log import ProgressRow
from mbot_workstation.learn.learning.run_directory import RunDirectory
from mbot_workstation.learn.studies.study_report import make_folder, markdown
from mbot_workstation.learn.worlds.robot_camera import (
    NOISE_SHARE,
    Glimpse,
    RobotCamera,
    observation_processor,
)
from mbot_workstation.learn.worlds.rooms import (
    CHOICE_ROOMS,
    EVALUATION_ROOMS,
    TRAINING_PHOTOGRAPHS,
    TRAINING_ROOMS,
    evaluation_rooms,
    gather_rooms,
    training_rooms,
)
from mbot_workstation.learn.worlds.shared_arrays import SharedMemory
from mbot_workstation.learn.worlds.worker import Done, Quit, Reset, StepAll, run_worker
from mbot_workstation.pictures.picture_file import read_picture
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.camera.frame_edges import FrameEdges
from mbot_workstation.sim.effects.effects import IDEAL, RealWorldEffects
from mbot_workstation.sim.effects.isp_settings import isp_settings
from mbot_workstation.sim.scene.target_object import RED_CUBE, Shape, TargetObject
from mbot_workstation.tasks.fetch.task import TASK

from .small_world import settings


def test_rooms_are_the_photographs_then_made_up_ones(tmp_path: Path) -> None:
    photo = tmp_path / "room.png"
    cv2.imwrite(str(photo), np.full((64, 128, 3), 90, np.uint8))
    rooms = gather_rooms([photo], 2, TRAINING_ROOMS)
    assert rooms[0].shape[1] == 128
    assert len(rooms) == 3
    again = gather_rooms([], 2, TRAINING_ROOMS)
    assert (rooms[1] == again[0]).all()
    assert (gather_rooms([], 1, EVALUATION_ROOMS)[0] != again[0]).any()


@pytest.mark.slow
def test_every_second_room_to_train_in_has_a_wall_of_the_objects_colour() -> None:
    plain = gather_rooms([], 4, TRAINING_ROOMS)
    green_ball = TargetObject("ball", Shape.BALL, colour_srgb=(30, 150, 50))
    for thing, strongest in ((RED_CUBE, 0), (green_ball, 1)):
        rooms = training_rooms([], 4, [thing])
        changed = [(ours != theirs).any(axis=-1) for ours, theirs in zip(rooms, plain, strict=True)]
        assert [bool(where.any()) for where in changed] == [True, False, True, False]
        for room, where in zip(rooms[::2], changed[::2], strict=True):
            assert 0.02 < where.mean() < 0.1, "a wall, less what stands before it"
            assert np.median(room[where], axis=0).argmax() == strongest


@pytest.mark.slow
def test_nobody_is_tried_in_a_room_trained_in(tmp_path: Path) -> None:
    assert [path.stem for path in TRAINING_PHOTOGRAPHS] == ["apartment", "hall", "lab", "venice"]
    trained_in = training_rooms(TRAINING_PHOTOGRAPHS, 4, [RED_CUBE])
    tried_in = evaluation_rooms([])
    assert len(tried_in) == 6
    kept_back = gather_rooms([], 6, CHOICE_ROOMS)
    every = [room.tobytes() for room in (*trained_in, *tried_in, *kept_back)]
    assert len(set(every)) == len(every)
    photo = tmp_path / "room.png"
    cv2.imwrite(str(photo), np.full((64, 128, 3), 90, np.uint8))
    assert len(evaluation_rooms([photo])) == 1
    assert len(evaluation_rooms([photo], 2)) == 3
    assert len(evaluation_rooms([], 0)) == 2


def test_effects_become_a_cameras_processing() -> None:
    assert isp_settings(IDEAL).has_curve is False
    made = isp_settings(
        RealWorldEffects(exposure_gain=0.8, red_gain=1.1, auto_exposure=1.0, jpeg_quality=60.0),
        0.25,
    )
    assert made.gains == pytest.approx((0.88, 0.8, 0.8))
    assert made.has_curve
    assert made.jpeg_quality == 90


def test_an_observations_noise_is_a_share_of_a_frames() -> None:
    camera = observation_processor(1)
    camera.become(isp_settings(RealWorldEffects(noise=5.0)))
    grey = np.full((64, 64, 3), 128, np.uint8)
    spread = float((camera.process(grey, 0.0).astype(float) - 128).std())
    assert 0.5 < spread < 5.0
    assert 0 < NOISE_SHARE < 1


def test_a_robots_camera_repeats_itself_by_its_seed() -> None:
    edges = FrameEdges(RobotParameters().camera)
    drawn = np.full((64, 64, 3), 100, np.uint8)
    pictures = []
    for _ in range(2):
        camera = RobotCamera(3, edges)
        camera.become(RealWorldEffects(noise=2.0), pitch_down_deg=5.0)
        camera.begin(0.0)
        glimpse = Glimpse(state=None, turn_rate_rad_s=0.0, time_s=0.0)  # pyright: ignore[reportArgumentType]
        view = camera.view(glimpse)
        pictures.append(camera.picture(drawn, view, glimpse))
    assert (pictures[0] == pictures[1]).all()
    assert pictures[0].std() > 0


def test_memory_is_shared_by_its_arrays() -> None:
    memory = SharedMemory.allocate(multiprocessing.get_context("spawn"), 3, TASK)
    one, other = memory.arrays(), memory.arrays()
    one.actions[1] = (0.5, -0.5)
    one.frames[2] = 7
    assert other.actions[1].tolist() == [0.5, -0.5]
    assert (other.frames[2] == 7).all()
    assert other.records.shape == (3,)


def test_a_worker_serves_its_share_until_told_to_quit() -> None:
    ours, theirs = multiprocessing.Pipe()
    memory = SharedMemory.allocate(multiprocessing.get_context("spawn"), 1, TASK)
    for request in ("fetch", settings(), Reset(seeds=(5,)), StepAll(), Quit()):
        ours.send(request)
    before = signal.getsignal(signal.SIGINT)
    try:
        run_worker(theirs, memory, range(1))  # a worker ignores Ctrl-C, and this process is none
    finally:
        signal.signal(signal.SIGINT, before)
    assert [ours.recv() for _ in range(3)] == [Done()] * 3
    assert memory.arrays().frames[0].std() > 0


def test_a_run_without_checkpoints_is_no_source(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=str(tmp_path)):
        find_source(tmp_path)


def test_the_codes_state_is_its_commit_and_what_has_changed(tmp_path: Path) -> None:
    here = git_state()
    assert here.commit == "" or len(here.commit) == 40
    outside = git_state(tmp_path)
    assert (outside.commit, outside.changed_files) == ("", ())


def png_size(path: Path) -> tuple[int, int]:
    """Height and width."""
    height_px, width_px, _ = read_picture(path).shape
    return height_px, width_px


def test_a_curve_is_drawn(tmp_path: Path) -> None:
    rows = [
        ProgressRow(step, 10.0, lesson, 2.0, 20.0, 1.0, 100)
        for step, lesson in ((40_000, "1"), (80_000, "2"))
    ]
    draw_curves({"a run": rows}, TASK, tmp_path / "curve.png")
    plain, _ = png_size(tmp_path / "curve.png")
    paid = [replace(row, terms={"approach": 0.5, "haste": -0.1}) for row in rows]
    draw_curves({"a run": paid}, TASK, tmp_path / "terms.png")
    assert png_size(tmp_path / "terms.png")[0] > plain > 300, "a panel more"
    assert mark_note(TASK, "10") == ""
    assert "rough, is harder than the paper's" in mark_note(TASK, "rough")


def test_a_report_without_lines_is_a_table_without_rows(tmp_path: Path) -> None:
    make_folder(tmp_path / "new")
    assert (tmp_path / "new").is_dir()
    assert markdown([], TASK).count("|") > 5


def test_a_checkpoint_for_which_there_is_no_room_leaves_nothing(tmp_path: Path) -> None:
    run = RunDirectory.create(tmp_path / "first")

    def full(folder: Path) -> None:
        (folder / "model.zip").touch()
        raise OSError(errno.ENOSPC, "No space left on device")

    with pytest.raises(ConfigurationError, match=r"No space left.*make room.*begin again"):
        run.add_checkpoint(64, full)
    assert list((run.path / "checkpoints").iterdir()) == []
    run.forget_unless_begun()
    assert not run.path.exists(), "its name is free again"
    run = RunDirectory.create(tmp_path / "first")
    run.add_checkpoint(64, lambda folder: (folder / "model.zip").touch())
    with pytest.raises(ConfigurationError, match="go on with --resume"):
        run.add_checkpoint(128, full)
    run.forget_unless_begun()
    assert [path.name for path in run.checkpoints()] == ["000000064"]
