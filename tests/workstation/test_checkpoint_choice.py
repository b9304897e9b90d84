import json
import threading
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.train import TrainOptions
from mbot_workstation.cli.train import _resumed as resumed
from mbot_workstation.cli.train import _train_until_stopped as train_until_stopped
from mbot_workstation.learn.evaluation import checkpoint_choice
from mbot_workstation.learn.evaluation.checkpoint_choice import choose_checkpoint, is_undecided
from mbot_workstation.learn.evaluation.episodes import EpisodeResult, Score, Trial, score
from mbot_workstation.learn.learning.checkpoint import STATE_FILE, read_weights
from mbot_workstation.learn.learning.learner import LearnerSettings
from mbot_workstation.learn.learning.policy_source import find_source
from mbot_workstation.learn.learning.progress_display import LineDisplay
from mbot_workstation.learn.learning.run_directory import RunDirectory, first_candidate
from mbot_workstation.learn.learning.trained_policy import trained_policy
from mbot_workstation.learn.learning.training_config import TrainingConfig
from mbot_workstation.learn.learning.training_run import begin_run

SHORT = TrainingConfig(
    steps=64,
    robots=2,
    workers=1,
    preset="ideal",
    lessons=("1",),
    made_up_rooms=1,
    learner=LearnerSettings(steps_per_robot=4, batch=8, epochs=1),
    checkpoint_every=8,
)


@pytest.fixture
def run(tmp_path: Path) -> RunDirectory:
    made = begin_run(tmp_path / "run", SHORT)
    for step in range(8, 65, 8):
        made.add_checkpoint(step, lambda _folder: None, kept_from=first_candidate(64))
    return made


def rewards(monkeypatch: pytest.MonkeyPatch, by_name: dict[str, float]) -> list[Trial]:
    trials: list[Trial] = []

    def tried(checkpoint: Path, trial: Trial) -> Score:
        trials.append(trial)
        return score([EpisodeResult(by_name[checkpoint.name], 10, 1, True)])

    def averaged(folder: Path, checkpoints: Sequence[Path]) -> None:
        (folder / STATE_FILE).write_text(" ".join(one.name for one in checkpoints))

    monkeypatch.setattr(checkpoint_choice, "_tried", tried)
    monkeypatch.setattr(checkpoint_choice, "write_average", averaged)
    return trials


def choose(run: RunDirectory, stop: threading.Event | None = None) -> None:
    choose_checkpoint(run, SHORT, LineDisplay(), stop or threading.Event())


@pytest.mark.slow
def test_the_last_fifth_is_kept_and_tried_and_the_best_is_the_policy(
    run: RunDirectory, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    trials = rewards(monkeypatch, {"000000056": 2.5, "000000064": 2.0, "average": 2.2})
    choose(run)
    assert find_source(run.path).checkpoint.name == "000000056"
    assert run.last_checkpoint().name == "000000064"  # what --resume goes on from
    assert len(trials) == 6
    assert trials[0] == trials[1] == trials[2]  # the same robots and rooms for all
    assert trials[3] == trials[4] == trials[5]
    assert trials[3].seed != trials[0].seed
    assert "000000056 is the policy: mean reward 2.50" in capsys.readouterr().err
    choose(run)
    assert len(trials) == 6  # once is enough


@pytest.mark.slow
def test_who_was_lucky_in_the_short_trial_does_not_win_the_long_one(
    run: RunDirectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = {"000000056": 2.5, "000000064": 2.0, "average": 1.5}
    trials = rewards(monkeypatch, first)
    monkeypatch.setattr(checkpoint_choice, "FINALISTS", 2)
    stop = threading.Event()
    display = LineDisplay()
    monkeypatch.setattr(display, "say", lambda text: stop.set() if "3 of 3" in text else None)
    choose_checkpoint(run, SHORT, display, stop)
    assert find_source(run.path).checkpoint.name == "000000056", "of a first round alone"
    first |= {"000000056": 1.9}
    choose(run)
    assert find_source(run.path).checkpoint.name == "000000064"
    assert len(trials) == 3 + 2


@pytest.mark.slow
def test_the_average_of_those_tried_may_be_the_policy(
    run: RunDirectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    rewards(monkeypatch, {"000000056": 2.5, "000000064": 2.0, "average": 2.7})
    choose(run)
    chosen = find_source(run.path)
    assert chosen.checkpoint == run.average
    assert find_source(run.average) == chosen
    assert (run.average / STATE_FILE).read_text() == "000000056 000000064"
    assert run.last_checkpoint().name == "000000064"  # what --resume goes on from
    run.add_checkpoint(72, lambda _folder: None, kept_from=56)
    assert find_source(run.path).checkpoint.name == "000000072"


@pytest.mark.slow
def test_what_was_trained_since_is_not_left_behind(
    run: RunDirectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    rewards(monkeypatch, {"000000056": 2.5, "000000064": 2.0, "average": 2.2})
    choose(run)
    run.add_checkpoint(72, lambda _folder: None, kept_from=56)
    assert find_source(run.path).checkpoint.name == "000000072"


def test_of_a_run_that_was_kept_for_its_policy_the_average_is_left() -> None:
    kept = Path(__file__).parents[2] / "models" / "red-cube-homes-run"
    assert find_source(kept).checkpoint.name == "average"
    weights = read_weights(kept / "checkpoints" / "average")
    once = {one.data_ptr(): one.nbytes for one in weights.values()}
    size = (kept / "checkpoints" / "average" / "model.zip").stat().st_size
    assert size < 1.02 * sum(once.values()), "layers of several names are written once"


def test_where_there_is_nothing_to_choose_from_nothing_is_undecided(tmp_path: Path) -> None:
    made = begin_run(tmp_path / "run", SHORT)
    made.add_checkpoint(64, lambda _folder: None, kept_from=first_candidate(64))
    assert not is_undecided(made)
    with pytest.raises(ConfigurationError, match="has made 64 decisions already"):
        resumed(TrainOptions(resume=made.path))


def test_a_choice_that_is_damaged_or_gone_is_the_last_checkpoint(run: RunDirectory) -> None:
    noted = {"chosen": "../../else", "tried": {"000000064": [1, 1, 1]}, "episodes": 2}
    run.choice_file.write_text(json.dumps(noted))
    assert find_source(run.path).checkpoint.name == "000000064"
    run.choice_file.write_text("{")
    assert find_source(run.path).checkpoint.name == "000000064"


@pytest.mark.slow
def test_a_stop_leaves_nothing_chosen(run: RunDirectory, monkeypatch: pytest.MonkeyPatch) -> None:
    rewards(monkeypatch, {})
    stop = threading.Event()
    stop.set()
    choose(run, stop)
    assert not run.choice_file.exists()


@pytest.mark.slow
def test_a_whole_run_ends_with_a_choice_by_driving(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(checkpoint_choice, "EPISODES", 2)
    monkeypatch.setattr(checkpoint_choice, "FINAL_EPISODES", 3)
    monkeypatch.setattr(checkpoint_choice, "FINALISTS", 2)
    monkeypatch.setattr(checkpoint_choice, "ROOMS", 1)
    made = begin_run(tmp_path / "run", SHORT)
    assert train_until_stopped(made, SHORT).reason == "steps"
    noted = json.loads(made.choice_file.read_text())
    assert set(noted["tried"]) == {"000000056", "000000064", "average"}
    assert set(noted["finals"]) < set(noted["tried"])
    assert (noted["episodes"], noted["final_episodes"], len(noted["finals"])) == (2, 3, 2)
    best = max(noted["finals"], key=lambda name: noted["finals"][name][0])
    assert noted["chosen"] == best == find_source(made.path).checkpoint.name
    assert all(low <= mean <= high for mean, low, high in noted["tried"].values())
    last, before, mean = (read_weights(one) for one in (*made.checkpoints()[-2:], made.average))
    assert set(mean) == set(last)
    for name, value in mean.items():
        torch.testing.assert_close(value, (last[name] + before[name]) / 2)
    assert any(not torch.equal(last[name], before[name]) for name in mean)
    assert trained_policy(made.average).provenance["checkpoint"] == "average"
    made.choice_file.unlink()  # as if interrupted while they were tried
    again = train_until_stopped(*resumed(TrainOptions(resume=made.path)))
    assert (again.reason, again.step) == ("steps", 64)
    assert json.loads(made.choice_file.read_text()) == noted


@pytest.mark.slow
def test_a_run_that_was_interrupted_while_choosing_can_be_resumed(
    run: RunDirectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    resume = TrainOptions(resume=run.path)
    assert resumed(resume)[1].steps == SHORT.steps
    with pytest.raises(ConfigurationError, match="has made 64 decisions already"):
        resumed(replace(resume, steps=64))
    rewards(monkeypatch, {"000000056": 2.5, "000000064": 2.0, "average": 2.2})
    choose(run)
    with pytest.raises(ConfigurationError, match="has made 64 decisions already"):
        resumed(resume)


def test_a_run_goes_on_where_the_network_can_learn(tmp_path: Path) -> None:
    """One that began on a machine with a GPU, on this one, and on no other than is asked for."""
    began = begin_run(tmp_path / "run", replace(SHORT, device="cuda"))
    resume = TrainOptions(resume=began.path)
    here = "cuda" if torch.cuda.is_available() else "cpu"
    assert resumed(resume)[1].device == here
    assert resumed(replace(resume, device="cpu"))[1].device == "cpu"
    with pytest.raises(ConfigurationError, match="expected auto, cpu or cuda"):
        resumed(replace(resume, device="tpu"))
