import io
from dataclasses import replace

import pytest
from rich.console import Console

from mbot_workstation.cli.train import trained_words
from mbot_workstation.learn.learning.progress_display import (
    LONGEST_GUESS_S,
    BarDisplay,
    RunMoment,
    figures,
)
from mbot_workstation.learn.learning.training_run import TrainingResult

MOMENT = RunMoment(8_192, 40_000, "10", (2.9, 60.0, 1.2), 400.0)


def test_between_two_moments_a_run_goes_on_as_fast_as_it_was() -> None:
    assert MOMENT.after(2.0).step == 8_992
    assert MOMENT.after(1e6).step == 8_192 + 400 * LONGEST_GUESS_S
    assert replace(MOMENT, step=39_900).after(10.0).step == 40_000


def test_no_time_left_is_negative() -> None:
    """Runs make whole rollouts, and so more decisions than they were asked for."""
    beyond = replace(MOMENT, step=41_000)
    assert beyond.left_s == 0.0
    assert beyond.after(1.0).step == 41_000
    assert "0:00:00 left" in figures(beyond)


def test_a_bar_moves_while_nobody_says_anything(monkeypatch: pytest.MonkeyPatch) -> None:
    clock_s = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: clock_s[0])
    shown = io.StringIO()
    console = Console(file=shown, force_terminal=True, width=120)
    bar = BarDisplay(console)

    def drawn() -> str:
        console.print(*bar.progress.get_renderables())
        return shown.getvalue().splitlines()[-1]

    bar.show(MOMENT)
    assert "20%" in drawn()
    clock_s[0] = 10.0
    assert "30%" in drawn()
    bar.show(replace(MOMENT, step=8_704))
    assert "30%" in drawn(), "it never goes back"


@pytest.mark.parametrize(
    ("reward", "following"), [(2.9, "train"), (None, "train"), (19.0, "export")]
)
def test_what_has_learned_little_is_trained_on(reward: float | None, following: str) -> None:
    result = TrainingResult("runs/first", "steps", 8_192, 20.0, "10", reward)
    *_, last = trained_words(result, 10.5)
    assert f"next: workstation {following} " in last
    assert ("--resume runs/first --steps 408192" in last) == (following == "train")
