"""When lessons are passed on, when a run ends, and what is saved of it."""

import threading
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from stable_baselines3.common.logger import Logger

from mbot_workstation.learn.learning.checkpoint import MODEL_FILE, CheckpointState, read_state
from mbot_workstation.learn.learning.curriculum import PAPER_MARK, PassMark
from mbot_workstation.learn.learning.progress_display import LineDisplay
from mbot_workstation.learn.learning.progress_log import read_progress
from mbot_workstation.learn.learning.run_directory import RunDirectory
from mbot_workstation.learn.learning.training_callback import TrainingCallback
from mbot_workstation.learn.learning.training_config import TrainingConfig
from mbot_workstation.tasks.fetch.task import TASK
from mbot_workstation.tasks.lesson import Lesson

CONFIG = TrainingConfig(
    steps=1000, lessons=("1", "2"), target_reward=2.0, checkpoint_every=64, row_every=100
)
GOOD, BAD = 3.0, -1.0


class Learning:
    """SB3's side of a run: calls the callback, and has nothing to save but a file's name."""

    def __init__(
        self, path: Path, start: CheckpointState | None = None, config: TrainingConfig = CONFIG
    ) -> None:
        self.run, self.task = RunDirectory(path), TASK
        self.lessons: list[str] = []
        self.stop = threading.Event()
        path.mkdir(exist_ok=True)
        self.callback = TrainingCallback(
            self.run, config, cast(Any, self), LineDisplay(), self.stop, start
        )
        self.saved: list[int] = []
        self._model = SimpleNamespace(
            num_timesteps=start.step if start else 0, logger=Logger(None, []), save=self._save
        )
        self.callback.init_callback(cast(Any, self._model))
        self.callback.on_training_start({}, {})

    def set_lesson(self, lesson: Lesson) -> None:
        """As the robots are told."""
        self.lessons.append(lesson.name)

    def decide(self, step: int, *rewards: float, lesson: str = "1") -> bool:
        """Episodes of a lesson end with this decision; whether learning may go on."""
        self._model.num_timesteps = step
        infos = [{"episode": {"r": r, "l": 40}, "touches": 1, "lesson": lesson} for r in rewards]
        self.callback.update_locals({"infos": infos})
        return self.callback.on_step()

    def update(self, step: int) -> None:
        """The weights are new, the next decisions are about to be made."""
        self._model.num_timesteps = step
        self.callback.on_rollout_start()

    def _save(self, path: Path) -> None:
        path.write_text("weights")
        self.saved.append(self._model.num_timesteps)


@pytest.fixture
def learning(tmp_path: Path) -> Learning:
    return Learning(tmp_path / "run")


def in_last_lesson(learning: Learning) -> None:
    """With a progress row behind it, the one in which the lesson began."""
    assert learning.decide(100, *[GOOD] * PAPER_MARK.episodes)
    assert learning.callback.lesson == "2"


def test_the_robots_get_the_next_lesson_when_enough_episodes_were_good(learning: Learning) -> None:
    assert learning.decide(10, *[GOOD] * (PAPER_MARK.episodes - 1))
    assert learning.decide(11, GOOD, lesson="2")  # another lesson's counts for none
    assert learning.lessons == []
    assert learning.decide(12, GOOD)
    assert learning.lessons == ["2"]
    assert learning.decide(13, *[GOOD] * PAPER_MARK.episodes)  # begun before the change
    assert learning.decide(14, *[GOOD] * PAPER_MARK.episodes, lesson="2")
    assert learning.lessons == ["2"], "the last one has no next"


def test_a_run_may_set_a_lower_mark(tmp_path: Path) -> None:
    learning = Learning(tmp_path / "run", config=replace(CONFIG, pass_mark=PassMark(2, 0.9)))
    assert learning.decide(10, GOOD)
    assert learning.lessons == []
    assert learning.decide(11, GOOD)
    assert learning.lessons == ["2"]


def test_the_target_counts_in_the_last_lesson_only(learning: Learning) -> None:
    for step in (100, 200, 300):
        assert learning.decide(step, GOOD)
    assert learning.callback.reason == "steps"


def test_the_target_ends_the_run_but_not_in_the_row_in_which_the_last_lesson_began(
    learning: Learning,
) -> None:
    in_last_lesson(learning)
    assert learning.decide(200, BAD, GOOD, lesson="2"), "a mean of 1"
    assert learning.decide(299, GOOD, lesson="2"), "no row is due"
    assert not learning.decide(300, GOOD, lesson="2")
    assert learning.callback.reason == "target"
    assert [row.lesson for row in read_progress(learning.run.progress_file)] == ["2", "2", "2"]


def test_without_a_wish_to_stop_or_a_target_reached_learning_goes_on(learning: Learning) -> None:
    assert learning.decide(1)
    learning.stop.set()
    assert not learning.decide(2)
    assert learning.callback.reason == "interrupted"


def test_there_is_one_checkpoint_of_a_step_and_none_too_early(learning: Learning) -> None:
    learning.update(63)
    assert learning.saved == []
    learning.update(64)
    learning.callback.save()
    learning.update(64)
    learning.update(127)
    assert learning.saved == [64]
    learning.decide(130)
    learning.callback.save()  # the run's end
    assert learning.saved == [64, 130]
    assert [path.name for path in learning.run.checkpoints()] == ["000000064", "000000130"]
    assert all((path / MODEL_FILE).exists() for path in learning.run.checkpoints())


def test_a_run_that_goes_on_knows_its_lesson_time_and_reward(
    learning: Learning, tmp_path: Path
) -> None:
    in_last_lesson(learning)
    learning.callback.save()
    state = read_state(learning.run.last_checkpoint())
    assert (state.step, state.mean_reward) == (100, GOOD)
    again = Learning(tmp_path / "run", state)
    assert (again.callback.lesson, again.callback.mean_reward) == ("2", GOOD)
    assert again.callback.wall_s >= state.wall_s > 0
    again.callback.save()
    assert again.saved == [], "nothing is new"
    assert again.decide(150, lesson="2")
    assert len(read_progress(again.run.progress_file)) == 1
