import io
import itertools
import json
import math
import pickle
import shutil
import signal
import subprocess
import threading
import time
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.vec_env import DummyVecEnv
from torch.distributions import Normal

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli import train as command
from mbot_workstation.learn.learning import picture_ppo, run_plan, training_run
from mbot_workstation.learn.learning.checkpoint import read_state, read_weights, restore_learner
from mbot_workstation.learn.learning.collection import Collection
from mbot_workstation.learn.learning.curriculum import GUIDED_MARK, PAPER_MARK, CurriculumState
from mbot_workstation.learn.learning.full_speed import KEEPS_TURNS
from mbot_workstation.learn.learning.learner import GUIDED, LearnerSettings, make_learner
from mbot_workstation.learn.learning.memory_policy import (
    MEMORY_UNITS,
    MemoryPolicy,
    PolicyInput,
)
from mbot_workstation.learn.learning.picture_ppo import PicturePPO
from mbot_workstation.learn.learning.progress_display import LineDisplay
from mbot_workstation.learn.learning.progress_log import FinishedEpisode, ProgressLog, read_progress
from mbot_workstation.learn.learning.run_directory import RunDirectory
from mbot_workstation.learn.learning.training_config import TrainingConfig, read_config
from mbot_workstation.learn.learning.training_run import TrainingResult, begin_run, train
from mbot_workstation.learn.worlds.task_vec_env import TaskVecEnv
from mbot_workstation.sim.scene.room_generator import generate_room
from mbot_workstation.tasks.fetch.task import TASK
from mbot_workstation.tasks.find import find_task

from ..ran import WORKSTATION, ran
from ..until import until

TINY = TrainingConfig(
    steps=128,
    robots=2,
    workers=1,
    preset="ideal",
    made_up_rooms=1,
    learner=LearnerSettings(steps_per_robot=32, batch=32, epochs=2),
    checkpoint_every=64,
    row_every=64,
)
LIMIT_S = 60


def test_neighbouring_seeds_have_no_robot_in_common(monkeypatch: pytest.MonkeyPatch) -> None:
    first: list[int] = []
    monkeypatch.setattr(training_run, "TaskVecEnv", lambda **told: first.append(told["seed"]))
    for seed in range(4):
        training_run.environment_of(replace(TINY, robots=16, seed=seed))
    assert np.diff(first).tolist() == [16, 16, 16], "robots count up from it"


def run_to_end(run: RunDirectory, config: TrainingConfig) -> TrainingResult:
    return train(run, config, LineDisplay(), threading.Event())


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> RunDirectory:
    run = begin_run(tmp_path_factory.mktemp("runs") / "whole", TINY)
    result = run_to_end(run, TINY)
    assert (result.step, result.reason, result.lesson) == (128, "steps", "1")
    return run


def test_who_stops_a_run_that_learns_to_see_begins_it_again(tmp_path: Path) -> None:
    config = replace(TINY, learner=replace(TINY.learner, eye_pictures=64))
    run = begin_run(tmp_path / "run", config)
    stop = threading.Event()
    stop.set()
    result = train(run, config, LineDisplay(), stop)
    assert (result.reason, result.step) == ("interrupted", 0)
    assert run.checkpoints() == [], "it would go on with a network that has seen nothing"
    assert run_to_end(run, config).step == 128


def test_an_eye_that_has_learned_to_see_learns_no_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[str] = []
    survey = TaskVecEnv.survey

    def watched(environment: TaskVecEnv, pictures: int) -> Any:
        shown.append(environment.lesson.name)
        return survey(environment, pictures)

    monkeypatch.setattr(TaskVecEnv, "survey", watched)
    begins: list[torch.Tensor] = []
    begin_with = MemoryPolicy.begin_with

    def noted(policy: MemoryPolicy, advice: torch.nn.Linear) -> None:
        begins.append(advice.weight)
        begin_with(policy, advice)

    monkeypatch.setattr(MemoryPolicy, "begin_with", noted)
    learner = replace(
        TINY.learner, eye_pictures=64, guided_decisions=96, rehearsals=9, residual=True
    )
    config = replace(TINY, learner=learner, steps=128)
    run = begin_run(tmp_path / "run", config)
    run_to_end(run, config)
    first, *others = (read_weights(one) for one in run.checkpoints())
    run_to_end(run, replace(config, steps=192))  # interrupted, it goes on with the same eye
    others.append(read_weights(run.last_checkpoint()))
    assert shown == ["10"] * 3, "robots as in the last lesson"
    assert len(begins) == 1, "once: what was interrupted goes on with what it has learned"
    assert len(others) == 2
    for (name, weight), other in itertools.product(first.items(), others):
        same = torch.equal(weight, other[name])
        assert same == ("features_extractor" in name or name == KEEPS_TURNS), name


def test_what_an_eye_makes_of_pictures_is_kept_in_their_place() -> None:
    settings = replace(TINY.learner, residual=True)
    with TaskVecEnv(2, preset="ideal", rooms=[generate_room(0, 256)], workers=1) as environment:
        made = make_learner(environment, settings, seed=0, critic=TASK.critic)
        made.collection = Collection(environment)
        made.keep_eye(None)
        made.learn(64)
        (batch,) = made.rollout_buffer.sequences(64)
    assert batch.seen.shape == (32, 2, 256)
    policy = made.policy
    with torch.no_grad():
        fields = (batch.seen, batch.previous_actions, batch.forgot, batch.state)
        known = policy.unroll(*(torch.from_numpy(one) for one in fields), short=False)
    assert known.shape == (64, 256 + policy.units)
    assert torch.equal(known[:, :256], torch.from_numpy(batch.seen).flatten(0, 1))


def test_a_run_leaves_all_that_tells_its_story(finished: RunDirectory) -> None:
    assert read_config(finished.config_file) == TINY
    resolved = json.loads(finished.config_file.read_text())
    assert resolved["effects"]["low"]["exposure_ms"] == 0.0
    assert [lesson["name"] for lesson in resolved["lessons"]] == [str(n) for n in range(1, 11)]
    assert "torch" in resolved["libraries"]
    (session,) = json.loads(finished.git_file.read_text())
    assert set(session) == {"from_step", "commit", "changed_files"}
    assert [path.name for path in finished.checkpoints()] == ["000000064", "000000128"]
    assert list(finished.tensorboard.iterdir())


@pytest.mark.slow
def test_the_same_seed_gives_the_same_run(finished: RunDirectory, tmp_path: Path) -> None:
    again = begin_run(tmp_path / "again", TINY)
    run_to_end(again, TINY)
    assert_same_weights(finished, again)
    other = begin_run(tmp_path / "other", replace(TINY, seed=1, steps=64))
    run_to_end(other, replace(TINY, seed=1, steps=64))
    first, second = finished.checkpoints()[0], other.last_checkpoint()
    assert any(not torch.equal(a, b) for a, b in pairs(first, second))


@pytest.mark.slow
def test_a_run_goes_on_from_its_checkpoint(tmp_path: Path) -> None:
    run = begin_run(tmp_path / "short", replace(TINY, steps=64))
    run_to_end(run, replace(TINY, steps=64))
    before = read_weights(run.last_checkpoint())
    (tmp_path / "short" / "checkpoints" / "000000099.unfinished").mkdir()  # a crash's leftover
    result = run_to_end(run, TINY)
    assert result.step == 128
    state = read_state(run.last_checkpoint())
    assert state.step == 128
    assert state.wall_s > read_state(run.checkpoints()[0]).wall_s
    sessions = json.loads(run.git_file.read_text())
    assert [session["from_step"] for session in sessions] == [0, 64]
    after = read_weights(run.last_checkpoint())
    assert any(not torch.equal(before[name], after[name]) for name in after)
    assert run_to_end(run, TINY).step == 128  # nothing left to do


def test_fine_tuning_starts_from_the_parents_weights(
    finished: RunDirectory, tmp_path: Path
) -> None:
    still = replace(TINY.learner, learning_rate=0.0, final_learning_rate=0.0)
    config = replace(
        TINY, lessons=("blur",), parent=str(finished.last_checkpoint()), learner=still, steps=64
    )
    run = begin_run(tmp_path / "tuned", config)
    assert run_to_end(run, config).lesson == "blur"
    assert_same_weights(finished, run)


@pytest.mark.slow
def test_exploration_falls_as_planned(tmp_path: Path) -> None:
    louder = replace(TINY.learner, noise=0.4, final_noise=0.1, learning_rate=1e-9)
    config = replace(TINY, learner=replace(louder, final_learning_rate=1e-9))
    run = begin_run(tmp_path / "noise", config)
    run_to_end(run, config)
    rollout = config.learner.steps_per_robot * config.robots
    last_rollout_began = 1 - (config.steps - rollout) / config.steps
    noise = read_weights(run.last_checkpoint())["log_std"].exp()
    expected = config.learner.noise_at(last_rollout_began)
    assert 0.1 < expected < 0.4
    assert noise.tolist() == pytest.approx([expected] * 2, rel=1e-3)


def test_stop_ends_with_a_checkpoint(tmp_path: Path) -> None:
    run = begin_run(tmp_path / "stopped", TINY)
    stop = threading.Event()
    stop.set()
    result = train(run, TINY, LineDisplay(), stop)
    assert (result.reason, result.step) == ("interrupted", 2)
    assert read_state(run.last_checkpoint()).step == 2


@pytest.mark.slow
def test_ctrl_c_saves_and_resume_goes_on(tmp_path: Path) -> None:
    command = [*WORKSTATION, "train", "--runs", str(tmp_path), "--name", "run"]
    options = ["--robots", "2", "--workers", "1", "--made-up-rooms", "1", "--preset", "ideal"]
    options += ["--guide", "0"]  # it drives at once
    pipe = subprocess.PIPE
    events = tmp_path / "run" / "tensorboard"
    with subprocess.Popen(command + options, stdout=pipe, stderr=pipe, text=True) as process:
        try:
            assert until(lambda: events.is_dir() and process.poll() is None)
            time.sleep(1.0)
            process.send_signal(signal.SIGINT)
            out, errors = process.communicate(timeout=LIMIT_S)
        finally:
            process.kill()
    assert process.returncode == 130, errors
    assert "go on with --resume" in errors
    assert "decisions in" in out
    step = read_state(RunDirectory(tmp_path / "run").last_checkpoint()).step
    assert step > 0
    resumed = ran(*WORKSTATION, "train", "--resume", str(tmp_path / "run"), "--steps", "1")
    assert resumed.returncode == 2, resumed.stderr
    assert f"has made {step:,} decisions already, 1 are asked for" in resumed.stderr


def test_a_crash_while_saving_leaves_the_checkpoint_before(tmp_path: Path) -> None:
    def whole(folder: Path) -> None:
        (folder / "a").write_text("whole")

    run = RunDirectory.create(tmp_path / "run")
    good = run.add_checkpoint(1, whole)

    def crash(folder: Path) -> None:
        (folder / "a").write_text("ha")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run.add_checkpoint(2, crash)
    assert run.checkpoints() == [good]
    for step in (2, 3):
        run.add_checkpoint(step, whole)
    assert [path.name for path in run.checkpoints()] == ["000000002", "000000003"]


class Evil:
    """Unpickling it would write a file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> Any:
        return (Path.write_text, (self.path, "run"))


@pytest.mark.filterwarnings("ignore:Detected pickle protocol")
def test_a_strangers_checkpoint_runs_no_code(tmp_path: Path) -> None:
    proof = tmp_path / "proof"
    for content in (pickle.dumps(Evil(proof)), torch_file(Evil(proof)), b"", b"nonsense"):
        with zipfile.ZipFile(tmp_path / "model.zip", "w") as archive:
            archive.writestr("policy.pth", content)
            archive.writestr("data", content)
        with pytest.raises(ConfigurationError, match="damaged"):
            read_weights(tmp_path)
    (tmp_path / "model.zip").write_bytes(b"PK")
    with pytest.raises(ConfigurationError, match="damaged"):
        read_weights(tmp_path)
    assert not proof.exists()


def torch_file(content: object) -> bytes:
    data = io.BytesIO()
    torch.save(content, data)
    return data.getvalue()


def test_what_is_no_run_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="not a training run"):
        RunDirectory.open(tmp_path)
    with pytest.raises(ConfigurationError, match="exists already"):
        RunDirectory.create(tmp_path)
    with pytest.raises(ConfigurationError, match="no checkpoint yet"):
        RunDirectory(tmp_path).last_checkpoint()
    with pytest.raises(ConfigurationError, match="expected one of"):
        TrainingConfig(preset="perfect")
    with pytest.raises(ConfigurationError, match="robots: 0"):
        TrainingConfig(robots=0)


def test_progress_is_a_row_an_interval_and_forgets_a_lost_future(tmp_path: Path) -> None:
    path = tmp_path / "progress.csv"
    log = ProgressLog(path, "touches", row_every=100)
    log.add(FinishedEpisode(2.0, 10, 1))
    log.add(FinishedEpisode(-1.0, 30, 0))
    assert log.row_if_due(99, 1.0, "1") is None
    row = log.row_if_due(104, 1.0, "1")
    assert row is not None
    assert (row.mean_reward, row.mean_length, row.mean_count, row.episodes) == (0.5, 20, 0.5, 2)
    assert log.row_if_due(205, 2.0, "1") is None  # no episode has ended
    log.add(FinishedEpisode(3.0, 10, 1))
    assert log.row_if_due(206, 2.0, "2") is not None
    assert [row.step for row in read_progress(path)] == [104, 206]
    ProgressLog(path, "touches", step=150, row_every=100)
    assert [row.step for row in read_progress(path)] == [104]
    path.write_text("a,b\n1,2\n")
    with pytest.raises(ConfigurationError, match="columns"):
        read_progress(path)


def test_progress_says_what_each_term_of_the_reward_brought(tmp_path: Path) -> None:
    path = tmp_path / "progress.csv"
    log = ProgressLog(path, "laps", row_every=100, terms=("way", "haste"))
    log.add(FinishedEpisode(2.0, 10, 1, {"way": 3.0, "haste": -1.0}))
    log.add(FinishedEpisode(4.0, 30, 2, {"way": 4.5, "haste": -0.5}))
    row = log.row_if_due(104, 1.0, "1")
    assert row is not None
    assert row.terms == {"way": 3.75, "haste": -0.75}
    assert path.read_text().splitlines()[0].endswith(",mean_laps,episodes,mean_way,mean_haste")
    assert read_progress(path) == [row]
    ProgressLog(path, "laps", step=150, row_every=100, terms=("haste", "style"))
    (kept,) = read_progress(path)
    assert kept.terms["haste"] == -0.75
    assert math.isnan(kept.terms["style"]), "a task's file may have changed since"


class Pictures(gymnasium.Env[Any, Any]):
    """Random pictures and rewards."""

    observation_space = gymnasium.spaces.Box(0, 255, (64, 64, 3), np.uint8)
    action_space = gymnasium.spaces.Box(-1, 1, (2,), np.float32)

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        return self._picture(), {}

    def step(self, action: Any) -> Any:
        ended = bool(self.np_random.random() < 0.1)
        return self._picture(), float(self.np_random.normal()), ended, False, {}

    def _picture(self) -> Any:
        return self.np_random.integers(0, 256, (64, 64, 3), np.uint8)


@pytest.mark.parametrize("largest_gradient", [0.5, 20.0])  # every one is cut to it, and not
def test_threads_learn_what_stable_baselines_learns(
    largest_gradient: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a memory and with the whole rollout as one batch there is nothing else in it."""

    def evaluate_actions(self: MemoryPolicy, obs: Any, actions: Any) -> Any:
        known = self.features_extractor(obs.float())
        wheels = Normal(self.action_net(known), self.log_std.exp())
        values = self.value_of(known, torch.zeros(len(obs), self.critic_inputs))
        return values, wheels.log_prob(actions).sum(dim=1), wheels.entropy().sum(dim=1)

    monkeypatch.setattr(MemoryPolicy, "evaluate_actions", evaluate_actions)
    monkeypatch.setattr(picture_ppo, "has_short_floats", lambda device: False)
    settings = LearnerSettings(
        steps_per_robot=16,
        batch=32,
        epochs=3,
        memory_units=0,
        largest_gradient=largest_gradient,
    )
    learned: list[dict[str, torch.Tensor]] = []
    for update in (PicturePPO.train, PPO.train):
        environment = DummyVecEnv([Pictures, Pictures])
        learner = make_learner(environment, settings, seed=3, critic=TASK.critic)
        learner.set_logger(Logger(None, []))
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(PicturePPO, "train", update)
            learner.learn(64)
        learned.append(learner.policy.state_dict())
    start = make_learner(
        DummyVecEnv([Pictures]), settings, seed=3, critic=TASK.critic
    ).policy.state_dict()
    for name, ours in learned[0].items():
        torch.testing.assert_close(ours, learned[1][name], rtol=0, atol=2e-5)
    moved = max(float((learned[0][name] - start[name]).abs().max()) for name in start)
    assert moved > 1e-3


def test_the_learning_rate_falls_evenly() -> None:
    settings = LearnerSettings(learning_rate=1.0, final_learning_rate=0.2)
    rates = [settings.learning_rate_at(remaining) for remaining in (1.0, 0.5, 0.0, -0.1)]
    assert rates == pytest.approx([1.0, 0.6, 0.2, 0.2])


def test_a_checkpoint_keeps_the_curriculum(finished: RunDirectory) -> None:
    state = read_state(finished.last_checkpoint())
    assert isinstance(state.curriculum, CurriculumState)
    assert len(state.curriculum.rewards) == state.curriculum.episodes


def pairs(first: Path, second: Path) -> list[tuple[torch.Tensor, torch.Tensor]]:
    ours, theirs = read_weights(first), read_weights(second)
    # The noise is the schedule's, not learned.
    return [(ours[name], theirs[name]) for name in ours if name != "log_std"]


def assert_same_weights(first: RunDirectory, second: RunDirectory) -> None:
    for ours, theirs in pairs(first.last_checkpoint(), second.last_checkpoint()):
        assert torch.equal(ours, theirs)


def configured(**given: Any) -> TrainingConfig:
    return command._configured(command.TrainOptions(**given))  # pyright: ignore[reportPrivateUsage]


def test_without_options_a_policy_with_memory_learns_from_a_guide_on_any_robot() -> None:
    config = configured()
    assert config.lessons == ("10", "rough")
    assert config.pass_mark == GUIDED_MARK
    assert config.steps == run_plan.STEPS
    assert config.learner.guided_decisions == run_plan.GUIDED_DECISIONS
    assert config.learner.memory_units == command.MEMORY_UNITS == MEMORY_UNITS
    assert config.learner.eye_pictures == GUIDED.eye_pictures
    assert configured(steps=300).learner.eye_pictures == 600, "few for a short run"


def test_the_papers_way_is_ten_lessons_without_guide_or_memory() -> None:
    config = configured(guide=0, memory=0)
    assert config.lessons == tuple(str(number) for number in range(1, 11))
    assert config.learner == LearnerSettings(memory_units=0)
    assert config.pass_mark == PAPER_MARK
    with pytest.raises(ConfigurationError, match="add --from RUN"):
        configured(guide=0, lesson=["rough"])


def test_a_run_keeps_its_object_and_says_when_its_file_is_gone(tmp_path: Path) -> None:
    file = tmp_path / "ball.toml"
    file.write_text(Path("models/objects/green-ball.toml").read_text())
    config = replace(TINY, steps=64, object_file=str(configured(object=file).object_file))
    run = begin_run(tmp_path / "run", config)
    assert run_to_end(run, config).step == 64
    (ball,) = read_config(run.config_file).scene.objects
    assert ball.name == "green ball"
    file.unlink()
    with pytest.raises(ConfigurationError, match=r"ball\.toml"):
        read_config(run.config_file)
    with pytest.raises(ConfigurationError, match="--calibration and --object"):
        command._resumed(command.TrainOptions(resume=run.path, object=file))  # pyright: ignore[reportPrivateUsage]


def test_for_another_colour_the_parents_first_layer_is_turned(
    finished: RunDirectory, tmp_path: Path
) -> None:
    file = Path("models/objects/green-ball.toml")
    told = configured(parent=finished.path, object=file, memory=0)
    assert told.hue_turn_deg == pytest.approx(131, abs=1)
    assert told.steps == run_plan.NEW_OBJECT_STEPS
    assert told.lessons == ("rough",)
    assert told.learner.guided_decisions == run_plan.NEW_OBJECT_GUIDED
    assert told.learner.first_filter_px == 8  # as the parent's, not as the guide's pupils have it
    config = replace(TINY, parent=told.parent, hue_turn_deg=told.hue_turn_deg)
    with TaskVecEnv(robots=2, workers=1, preset="ideal") as environment:
        red, green = (
            make_learner(environment, TINY.learner, seed=5, critic=TASK.critic) for _ in range(2)
        )
        restore_learner(Path(config.parent), red, with_optimizer=False)
        turn_deg = config.hue_turn_deg
        restore_learner(Path(config.parent), green, with_optimizer=False, turn_deg=turn_deg)
    weights = red.policy.state_dict()
    for name, value in green.policy.state_dict().items():
        same = torch.equal(value, weights[name])
        assert same != name.endswith("features_extractor.first.weight"), name
    same_object = configured(parent=finished.path, memory=0)
    assert same_object.hue_turn_deg == 0


def test_another_tasks_policy_goes_on_with_the_eye_and_a_critic_of_its_own(
    finished: RunDirectory,
) -> None:
    parent = finished.last_checkpoint()
    other = find_task("bring")
    settings: dict[str, Any] = {"task": "bring", "lesson": other.lessons[0]}
    with TaskVecEnv(robots=2, workers=1, preset="ideal", **settings) as environment:
        learner = make_learner(environment, TINY.learner, seed=5, critic=other.critic)
        fresh = {name: value.clone() for name, value in learner.policy.state_dict().items()}
        restore_learner(parent, learner, with_optimizer=False)
        known = read_weights(parent)
        for name, value in learner.policy.state_dict().items():
            expected = fresh if name.startswith("value_net.") else known
            assert torch.equal(value, expected[name]), name
        with pytest.raises(ConfigurationError, match="weights of another network"):
            restore_learner(parent, learner, with_optimizer=True)


@pytest.mark.parametrize(("residual", "guide"), [(True, 90_000), (True, 0), (False, 90_000)])
def test_an_eye_that_sees_learns_what_else_there_is(
    finished: RunDirectory, tmp_path: Path, residual: bool, guide: int
) -> None:
    parent = shutil.copytree(finished.path, tmp_path / "parent")
    config = RunDirectory(parent).config_file
    told = json.loads(config.read_text())
    told["training"]["learner"]["residual"] = residual
    config.write_text(json.dumps(told))
    pictures = configured(parent=parent, guide=guide).learner.eye_pictures
    assert pictures == (run_plan.MORE_PICTURES if residual and guide else 0)
    few = configured(parent=parent, guide=guide, steps=500).learner.eye_pictures
    assert few == (1000 if residual and guide else 0)


@pytest.mark.slow
def test_a_policy_without_memory_gets_one_that_it_does_not_heed_yet(tmp_path: Path) -> None:
    paper = replace(TINY, learner=replace(TINY.learner, memory_units=0))
    parent = begin_run(tmp_path / "paper", paper)
    run_to_end(parent, paper)
    config = configured(parent=parent.path, memory=16)
    assert (config.learner.guided_decisions, config.lessons) == (0, ("rough",))
    with TaskVecEnv(robots=2, workers=1, preset="ideal") as environment:
        learner = make_learner(environment, config.learner, seed=5, critic=TASK.critic)
        restore_learner(Path(config.parent), learner, with_optimizer=False)
        before = make_learner(environment, paper.learner, seed=6, critic=TASK.critic)
        restore_learner(Path(config.parent), before, with_optimizer=True)
        pictures = environment.reset()
        state, told = torch.randn(2, 16), torch.rand(2, 2)
        sight = torch.from_numpy(pictures)
        for remembered in (torch.zeros(2, 16), state):
            ours = learner.policy.decide(PolicyInput(sight, remembered, told))
            theirs = before.policy.predict(pictures, deterministic=True)[0]
            np.testing.assert_allclose(ours.actions.detach(), theirs, rtol=0, atol=1e-5)
    with pytest.raises(ConfigurationError, match="weights of another network"):
        restore_learner(Path(config.parent), learner, with_optimizer=True)


def test_a_name_is_no_path(tmp_path: Path) -> None:
    options = command.TrainOptions(runs=tmp_path / "runs", name="../evil")
    with pytest.raises(ConfigurationError, match=r"--name is '../evil', expected a folder's name"):
        command._begun(options)  # pyright: ignore[reportPrivateUsage]
    assert not (tmp_path / "evil").exists()
