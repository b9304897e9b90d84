"""What happens beside learning: lessons, progress, checkpoints, and knowing when to stop."""

import threading
import time
from typing import Any

from stable_baselines3.common.callbacks import BaseCallback

from mbot_workstation.learn.learning.checkpoint import (
    CheckpointState,
    RandomState,
    write_checkpoint,
)
from mbot_workstation.learn.learning.curriculum import CurriculumState, after_episode, is_last
from mbot_workstation.learn.learning.progress_display import RunDisplay, RunMoment
from mbot_workstation.learn.learning.progress_log import FinishedEpisode, ProgressLog, ProgressRow
from mbot_workstation.learn.learning.run_directory import RunDirectory, first_candidate
from mbot_workstation.learn.learning.training_config import TrainingConfig
from mbot_workstation.learn.worlds.task_vec_env import TaskVecEnv

SHOW_EVERY_S = 0.25


class TrainingCallback(BaseCallback):
    """Stands beside SB3's learning loop; the loop calls it before and after every part.

    Attributes:
        curriculum: where the lessons stand.
        reason: why the run ended: "steps", "target" or "interrupted".

    """

    model: Any

    def __init__(
        self,
        run: RunDirectory,
        config: TrainingConfig,
        environment: TaskVecEnv,
        display: RunDisplay,
        stop: threading.Event,
        start: CheckpointState | None,
    ) -> None:
        """Prepare to teach, from the beginning or from a checkpoint's state."""
        super().__init__()
        self.curriculum = start.curriculum if start else CurriculumState()
        self.reason = "steps"
        self._run = run
        self._config = config
        self._stages = config.stages()
        self._environment = environment
        self._display = display
        self._stop = stop
        self._step_0 = self._saved_step = start.step if start else 0
        self._wall_0_s = start.wall_s if start else 0.0
        self._mean_reward = start.mean_reward if start else None
        self._counted = environment.task.counted
        self._terms = environment.task.terms
        self._progress = ProgressLog(
            run.progress_file, self._counted, self._step_0, config.row_every, self._terms
        )
        self._row_lesson = ""
        self._started_s = self._shown_s = time.monotonic()

    @property
    def lesson(self) -> str:
        """The current lesson's name."""
        return self._stages[self.curriculum.index].name

    @property
    def wall_s(self) -> float:
        """Training time so far, over all resumptions."""
        return self._wall_0_s + time.monotonic() - self._started_s

    @property
    def mean_reward(self) -> float | None:
        """Of the latest episodes, as the display shows it; of the last row before the first."""
        recent = self._progress.recent_means()
        return self._mean_reward if recent is None else recent[0]

    def save(self) -> None:
        """Write a checkpoint, unless there is one of this very step."""
        if self.num_timesteps == self._saved_step:
            return
        state = CheckpointState(
            self.num_timesteps, self.wall_s, self.curriculum, RandomState.now(), self._mean_reward
        )
        self._run.add_checkpoint(
            self.num_timesteps,
            lambda folder: write_checkpoint(folder, self.model, state),
            kept_from=first_candidate(self._config.steps),
        )
        self._saved_step = self.num_timesteps

    def _on_rollout_start(self) -> None:
        # Between an update and the next decision is the one moment at which weights, optimiser
        # and counters belong together.
        self.num_timesteps = self.model.num_timesteps
        if self.num_timesteps >= self._saved_step + self._config.checkpoint_every:
            self.save()

    def _on_step(self) -> bool:
        for info in self.locals["infos"]:
            if "episode" in info:
                self._end_episode(info)
        row = self._progress.row_if_due(self.num_timesteps, self.wall_s, self.lesson)
        if row is not None:
            self._take_row(row)
        self._show()
        if self._stop.is_set():
            self.reason = "interrupted"
        return self.reason == "steps"

    def _end_episode(self, info: dict[str, Any]) -> None:
        episode = info["episode"]
        reward = float(episode["r"])
        terms = {name: float(info[name]) for name in self._terms}
        count = int(info[self._counted])
        self._progress.add(FinishedEpisode(reward, int(episode["l"]), count, terms))
        before = self.curriculum.index
        self.curriculum = after_episode(
            self.curriculum, self._stages, info["lesson"], reward, self._config.pass_mark
        )
        if self.curriculum.index != before:
            self._environment.set_lesson(self._stages[self.curriculum.index])

    def _take_row(self, row: ProgressRow) -> None:
        self._mean_reward = row.mean_reward
        self._display.row(row, self._counted)
        self.logger.record("curriculum/lesson", self.curriculum.index + 1)
        self.logger.record(f"curriculum/{self._counted}", row.mean_count)
        for name, mean in row.terms.items():
            self.logger.record(f"reward/{name}", mean)
        target = self._config.target_reward
        # The row in which the last lesson began holds easier episodes too.
        began_in_it = self._row_lesson == self.lesson
        self._row_lesson = self.lesson
        in_last = began_in_it and is_last(self.curriculum, self._stages)
        if target is not None and in_last and row.mean_reward >= target:
            self.reason = "target"

    def _show(self) -> None:
        now_s = time.monotonic()
        if now_s - self._shown_s < SHOW_EVERY_S:
            return
        self._shown_s = now_s
        steps_per_s = (self.num_timesteps - self._step_0) / (now_s - self._started_s)
        self._display.show(
            RunMoment(
                self.num_timesteps,
                self._config.steps,
                self.lesson,
                self._progress.recent_means(),
                steps_per_s,
            )
        )
