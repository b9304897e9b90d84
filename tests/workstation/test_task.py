"""The door for tasks: one file, named on the command line, is learned, tried and driven."""

import ast
import hashlib
import json
import pickle
import re
import threading
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
import serial

from mbot_protocol.drive.mcore import BAUD_RATE, Joystick
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.policy.policy_contract import PolicyMetadata
from mbot_workstation.cli import evaluate as evaluate_command
from mbot_workstation.cli.models import check_model_file
from mbot_workstation.fleet.models.model_findings import PROVENANCE
from mbot_workstation.fleet.models.trained_task import TrainedTask, trained_task
from mbot_workstation.learn.evaluation.episodes import Trial, evaluate, score
from mbot_workstation.learn.learning.learner import LearnerSettings
from mbot_workstation.learn.learning.progress_display import LineDisplay
from mbot_workstation.learn.learning.progress_log import read_progress
from mbot_workstation.learn.learning.trained_policy import trained_policy
from mbot_workstation.learn.learning.training_config import TrainingConfig, read_config
from mbot_workstation.learn.learning.training_run import begin_run, train
from mbot_workstation.learn.worlds.task_env import TaskEnv
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.effects.presets import NOMINAL, preset
from mbot_workstation.sim.pose import ORIGIN
from mbot_workstation.sim.scene.object_mjcf import DISTRACTORS
from mbot_workstation.sim.scene.room_generator import generate_room
from mbot_workstation.sim.scene.target_object import RED_CUBE
from mbot_workstation.tasks.episode import Moment, Setting
from mbot_workstation.tasks.find import find_task, full_reference, task_digest, task_names
from mbot_workstation.tasks.lesson import lesson_named
from mbot_workstation.virtual.camera_stream import CameraSettings
from mbot_workstation.virtual.stand_in import VirtualRobot, VirtualRobotSettings

from ..until import until
from .called import output_of
from .samples import small_policy
from .small_world import ROOMS

CIRCLE = full_reference(str(Path(__file__).with_name("stay_in_circle.py")))
SOURCE = Path(__file__).parents[2] / "workstation" / "mbot_workstation"
ITS = Path(CIRCLE).read_text() + "\n"
FRAME = {"episode", "find", "lesson", "sight", "task"}


def test_another_task_is_a_file_of_less_than_200_lines() -> None:
    assert len(Path(CIRCLE).read_text().splitlines()) < 200
    assert len((SOURCE / "tasks" / "task.py").read_text().splitlines()) < 120


def test_its_tape_is_seen_and_its_rewards_are_paid() -> None:
    environment = TaskEnv("ideal", rooms=ROOMS, task=CIRCLE)
    picture, info = environment.reset(seed=1)
    assert info["lesson"] == "narrow"
    middle = picture[31:60, 24:40].mean(axis=(1, 2))
    assert middle.min() < np.median(middle) - 15, "a dark line across the floor"
    rewards, happenings = [], []
    ended = False
    while not ended:
        _, reward, ended, _, info = environment.step(np.ones(2, np.float32))
        rewards.append(reward)
        happenings.append(info["happening"])
    environment.close()
    assert happenings[-1] == "left"
    assert rewards[-1] == -1.0
    assert info["to_tape_m"] == 0


@pytest.mark.slow
def test_it_is_learned_for_2000_decisions_and_then_tried(tmp_path: Path) -> None:
    config = TrainingConfig(
        task=CIRCLE,
        steps=2000,
        robots=4,
        made_up_rooms=1,
        row_every=1000,
        learner=LearnerSettings(steps_per_robot=125, batch=125),
    )
    run = begin_run(tmp_path / "circle", config)
    result = train(run, config, LineDisplay(), threading.Event())
    assert (result.step, result.lesson) == (2000, "wide")
    with pytest.raises(ConfigurationError, match=r"--task FILE\.py"):
        read_config(run.config_file)  # a folder alone runs nobody's file
    assert read_config(run.config_file, CIRCLE).task == CIRCLE
    assert "mean_metres" in run.progress_file.read_text().splitlines()[0]
    assert read_progress(run.progress_file)[-1].episodes > 0
    made = trained_policy(run.path, CIRCLE).provenance
    assert (made["task"], made["lessons"]) == ("stay-in-circle", ["wide", "narrow"])
    assert made["task_sha256"] == hashlib.sha256(Path(CIRCLE).read_bytes()).hexdigest()

    lesson = lesson_named(find_task(CIRCLE).lessons, "wide")
    trial = Trial(lesson, preset("nominal"), ROOMS, episodes=4, workers=1, task=CIRCLE)
    assert score(evaluate("random", trial)).length.mean > 1
    with pytest.raises(ConfigurationError, match="no oracle"):
        evaluate("oracle", trial)


def test_a_digest_is_of_all_that_a_task_is_written_in(tmp_path: Path) -> None:
    file, beside = tmp_path / "whole.py", tmp_path / "part.py"
    beside.write_text("NUMBER = 1\n")
    file.write_text("from .part import NUMBER\n" + ITS)
    first = task_digest(str(file))
    beside.write_text("NUMBER = 2\n")
    second = task_digest(str(file))
    file.write_text("from .part import NUMBER\n\n" + ITS)
    assert len({first, second, task_digest(str(file)), task_digest(CIRCLE)}) == 4
    assert len(task_digest("fetch")) == 64
    borrowed = tmp_path / "borrowed.py"  # its task's class is written elsewhere
    borrowed.write_text("from mbot_workstation.tasks.fetch.task import TASK\n")
    assert task_digest(str(borrowed)) == hashlib.sha256(borrowed.read_bytes()).hexdigest()


def test_a_policy_of_another_task_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def policy(name: str, origin: dict[str, str]) -> str:
        told = PolicyMetadata(name).to_properties() | {PROVENANCE: json.dumps(origin)}
        (tmp_path / name).write_bytes(small_policy(properties=told).SerializeToString())
        return str(tmp_path / name)

    same = policy("a.onnx", {"task": "stay-in-circle", "task_sha256": task_digest(CIRCLE)})
    older = policy("b.onnx", {"task": "stay-in-circle", "task_sha256": "0" * 64})
    fetches = policy("c.onnx", {})
    said: list[str] = []
    monkeypatch.setattr(evaluate_command, "note", said.append)
    monkeypatch.setattr(evaluate_command, "_lines", lambda *_: pytest.fail("not tried"))
    with pytest.raises(pytest.fail.Exception):
        output_of(evaluate_command.evaluate, same, older, fetches, "--task", CIRCLE)
    assert said[-2:] == [
        f"{CIRCLE} is not as it was when {older} learned it",
        f"{fetches} learned the task fetch, and is tried in stay-in-circle",
    ]
    assert "its task is stay-in-circle" in output_of(check_model_file, same)
    assert trained_task(Path(fetches)) == TrainedTask("fetch", "")


def test_the_virtual_robot_plays_it() -> None:
    settings = VirtualRobotSettings(
        task=CIRCLE,
        lesson=lesson_named(find_task(CIRCLE).lessons, "narrow"),
        room_picture=generate_room(0, 64),
        camera=CameraSettings(width_px=64, height_px=48),
    )
    with VirtualRobot(settings) as robot:
        assert robot.wait_until_ready()
        with serial.Serial(str(robot.board.path), BAUD_RATE, timeout=5) as port:
            port.write(Joystick(-255, 255).to_bytes())
            assert port.read(4)
            assert until(robot.stopped.is_set)
        events = [robot.world.events.get_nowait() for _ in range(robot.world.events.qsize())]
        result = robot.world.status().result
    assert events[-1].happening == "left"
    assert result["score"] == sum(event.score for event in events)
    assert result["distance_driven_m"] == pytest.approx(0.71, abs=0.05)
    assert json.dumps(dict(result))


@pytest.mark.parametrize(
    ("reference", "content", "problem"),
    [
        ("fetsh", None, "did you mean"),
        ("none.py", None, "no file"),
        ("empty.py", "", "names no TASK"),
        ("broken.py", "1 / 0", "ZeroDivisionError"),
        ("quits.py", "raise SystemExit(0)", "SystemExit"),
        ("other.py", "TASK = 1", "TASK is a int"),
        (
            "bare.py",
            "from mbot_workstation.tasks.task import Task\nclass A(Task): pass\nTASK = A()",
            "no name",
        ),
        ("taken.py", ITS + "TASK.facts = np.dtype([('metres', int), ('reward', float)])", "reward"),
        ("counts.py", ITS + "TASK.counted = 'laps'", "laps"),
        ("errs.py", ITS + "TASK.mistakes = ('crashes',)", "crashes"),
        ("first.py", ITS + "TASK.happenings = ('left',)", "first of its happenings"),
        ("twice.py", ITS + "TASK.lessons *= 2", "name of its own"),
    ],
)
def test_what_is_no_task_is_refused(
    tmp_path: Path, reference: str, content: str | None, problem: str
) -> None:
    if content is not None:
        (tmp_path / reference).write_text(content)
    name = str(tmp_path / reference) if reference.endswith(".py") else reference
    with pytest.raises(ConfigurationError, match=problem):
        find_task(name)


def test_a_relative_name_and_two_files_of_one_name_are_no_trouble(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for folder in ("one", "other"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "circle.py").write_text(ITS)
    monkeypatch.chdir(tmp_path / "one")
    near, far = find_task("circle.py"), find_task(str(tmp_path / "other" / "circle.py"))
    assert near is find_task(str(tmp_path / "one" / "circle.py"))
    assert type(near) is not type(far)
    assert pickle.loads(pickle.dumps(near.lessons)) == near.lessons
    assert pickle.loads(pickle.dumps(far.lessons)) == far.lessons


def test_a_mistake_in_a_tasks_file_is_told_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "wrong.py"
    path.write_text(ITS.replace("self._left_s -= elapsed_s", "self._left_s -= nothing"))
    lesson = lesson_named(find_task(str(path)).lessons, "wide")
    trial = Trial(lesson, preset("ideal"), ROOMS, episodes=1, workers=1, task=str(path))
    line = path.read_text().splitlines().index("        self._left_s -= nothing") + 1
    with pytest.raises(ConfigurationError, match=rf"wrong.py:{line}: NameError"):
        evaluate("random", trial)


BESIDE = "from {} import StayInCircle\nTASK = StayInCircle()\n"


def test_a_task_imports_what_lies_beside_it_in_other_processes_too(tmp_path: Path) -> None:
    path, beside = tmp_path / "round.py", tmp_path / "circle.py"
    path.write_text(BESIDE.format(".circle"))
    beside.write_text(ITS.replace("self._left_s -= elapsed_s", "self._left_s -= nothing"))
    lesson = find_task(str(path)).lessons[0]
    trial = Trial(lesson, preset("ideal"), ROOMS, episodes=1, workers=1, task=str(path))
    line = beside.read_text().splitlines().index("        self._left_s -= nothing") + 1
    with pytest.raises(ConfigurationError, match=rf"circle.py:{line}: NameError"):
        evaluate("random", trial)
    (tmp_path / "plain.py").write_text(BESIDE.format("circle"))
    with pytest.raises(ConfigurationError, match=r"by `from \.circle import \.\.\.`"):
        find_task(str(tmp_path / "plain.py"))


BACK = """
class Back(Drive):
    def advance(self, robot, elapsed_s):
        far = robot.x_m > 0.05
        return Step("left", -1.0, robot_to_origin=True) if far else Step()

class BackTask(StayInCircle):
    def begin(self, lesson, setting, rng):
        return Back(lesson, setting)

TASK = BackTask()
"""


def test_training_puts_a_robot_back_as_the_virtual_robot_does(tmp_path: Path) -> None:
    path = tmp_path / "back.py"
    path.write_text(ITS + BACK)
    environment = TaskEnv("ideal", rooms=ROOMS, task=str(path))
    environment.reset(seed=1)
    for _ in range(6):
        environment.step(np.ones(2, np.float32))
        assert environment.world.robot.x_m < 0.15
    environment.close()


def test_worlds_learner_and_virtual_robot_know_no_task() -> None:
    """By import or by word: what a task calls its own stands in its folder."""
    rooms = ("learn", "virtual", "sim")
    for path in (path for room in rooms for path in (SOURCE / room).rglob("*.py")):
        text = path.read_text()
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.ImportFrom) and node.module:
                _, _, below = node.module.partition("mbot_workstation.tasks.")
                assert below == "" or below in FRAME, f"{path}: {node.module}"
        words = r"\b(?:Fetch(?!Object)\w*|fetch_\w+|touches|touched|at_border)\b"
        assert "sim" in path.parts or not re.findall(words, text), path
    assert task_names() == ("bring", "fetch", "hidden", "line", "obstacles", "stay")


@pytest.mark.parametrize("name", task_names())
def test_a_task_that_ships_lays_its_pieces_and_names_what_happens(name: str) -> None:
    """Numbers that JSON knows, in the result and in what is drawn; no piece is left out."""
    task = find_task(name)
    setting = Setting(0.09, 2.9, (RED_CUBE.footprint,))
    for seed in range(5):
        episode = task.begin(task.lessons[-1], setting, np.random.default_rng(seed))
        pieces = task.pieces(episode)
        assert (len(pieces) > 0) == (name != "fetch")
        assert len(pieces) <= len(DISTRACTORS)
        step = episode.advance(ORIGIN, 0.4)
        assert step.happening in task.happenings
        facts = episode.facts(Moment(ORIGIN, 0.4, ORIGIN, 0.35, 0.06))
        told = (dict(episode.result()), facts, [asdict(piece) for piece in pieces])
        assert json.dumps(told)
        assert np.array(facts, task.facts)[task.counted] == 0
        assert task.summary(episode.result())


@pytest.mark.parametrize("name", task_names())
def test_a_guide_says_of_whole_segments_what_pictures_show(name: str) -> None:
    task = find_task(name)
    guide = task.guide(4, NOMINAL, RobotParameters(), 8)
    assert guide is not None
    assert guide.shows(np.zeros((3, 4), task.facts)).shape == (3, 4)
