import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.evaluate import evaluate as command
from mbot_workstation.learn.drivers.contestants import Driver, driver
from mbot_workstation.learn.evaluation.episode_film import (
    LINE_PX,
    RATE_HZ,
    SIDE_PX,
    film_episode,
)
from mbot_workstation.learn.evaluation.episodes import (
    EpisodeResult,
    Trial,
    evaluate,
    evaluate_driver,
    score,
)
from mbot_workstation.learn.evaluation.evaluation_report import Line, draw, share_of_oracle
from mbot_workstation.sim.effects.effects import IDEAL
from mbot_workstation.sim.effects.presets import preset
from mbot_workstation.sim.scene.room_generator import generate_room
from mbot_workstation.tasks.fetch.oracle import Oracle
from mbot_workstation.tasks.fetch.task import TASK
from mbot_workstation.tasks.lesson import lesson_named

from .called import output_of

ROOMS = [generate_room(7, width_px=256)]


def trial(episodes: int, seed: int = 0, stage: str = "4") -> Trial:
    return Trial(
        lesson_named(TASK.lessons, stage), preset("nominal"), ROOMS, episodes, seed, workers=1
    )


@pytest.mark.slow
def test_the_oracle_beats_chance_and_fetches_everything() -> None:
    told = score(evaluate("oracle", trial(6)))
    chance = score(evaluate("random", trial(6)))
    assert told.success.mean == 1.0
    assert told.reward.low > chance.reward.high
    assert told.decisions_per_count is not None
    assert told.decisions_per_count.mean < 12


@pytest.mark.slow
def test_the_same_trial_gives_the_same_episodes() -> None:
    first, again = evaluate("servo", trial(5)), evaluate("servo", trial(5))
    assert len(first) == 5
    assert first == again
    assert evaluate("servo", trial(5, seed=9)) != first


def test_whoever_drives_blindly_runs_into_things_and_that_is_told() -> None:
    ahead = Driver(lambda pictures, _: np.full((len(pictures), 2), 0.8, np.float32), lambda _: None)
    home = replace(trial(16, stage="10"), preset=preset("home"))
    results = evaluate_driver(ahead, home)
    hits = [result.mistakes["wrong_things"] for result in results]
    assert sum(hits) > 0
    assert score(results).mistakes["wrong_things"].mean == pytest.approx(np.mean(hits), abs=1e-4)


def test_two_seeds_have_no_episode_in_common() -> None:
    """Robots count up from a trial's seed."""
    first, other = (
        {episode.reward for episode in evaluate("oracle", trial(6, seed, "1"))} for seed in (0, 1)
    )
    assert len(first) == len(other) == 6
    assert first.isdisjoint(other)


def test_each_robot_has_its_share_so_that_short_episodes_are_not_preferred() -> None:
    ended: list[int] = []
    results = evaluate("oracle", trial(20, stage="1"), ended.append)
    assert ended == list(range(1, 21))
    assert len(results) == 20


ANGLES = st.floats(-np.pi, np.pi)


@given(ANGLES, st.floats(0.3, 4.0))
def test_the_oracle_turns_towards_the_object_and_never_backs_away(
    angle: float, distance_m: float
) -> None:
    target = distance_m * np.array([[np.cos(angle), np.sin(angle)]])
    left, right = Oracle(1, IDEAL).act(target)[0]
    assert -1 <= left <= 1
    assert -1 <= right <= 1
    assert left + right >= -1e-6
    if abs(angle) > 0.1:
        assert (right > left) == (angle > 0)


def test_the_oracle_waits_until_it_knows() -> None:
    actions = Oracle(2, IDEAL).act(np.array([[np.nan, np.nan], [1.0, 0.0]]))
    np.testing.assert_allclose(actions, [[0, 0], [1, 1]], atol=1e-6)


results = st.lists(
    st.builds(
        EpisodeResult, st.floats(-1, 21), st.integers(1, 1670), st.integers(0, 10), st.booleans()
    ),
    min_size=1,
    max_size=30,
)


@given(results)
def test_a_score_holds_its_means_and_is_the_same_every_time(episodes: list[EpisodeResult]) -> None:
    made = score(episodes)
    assert made == score(episodes)
    assert made.reward.mean == pytest.approx(
        np.mean([episode.reward for episode in episodes]), abs=1e-3
    )
    for estimate in (made.reward, made.count, made.success, made.length):
        assert estimate.low <= estimate.high
    touches = sum(episode.count for episode in episodes)
    if touches == 0:
        assert made.decisions_per_count is None
    else:
        decisions = sum(episode.decisions for episode in episodes)
        assert made.decisions_per_count is not None
        assert made.decisions_per_count.mean == pytest.approx(decisions / touches, rel=1e-3)


def test_more_episodes_narrow_the_interval() -> None:
    rng = np.random.default_rng(0)
    episodes = [EpisodeResult(float(r), 100, 10, True) for r in rng.normal(15, 3, 400)]
    few, many = score(episodes[:25]).reward, score(episodes).reward
    assert many.low <= 15 <= many.high
    assert (many.high - many.low) < (few.high - few.low) / 2
    assert many.high - many.low == pytest.approx(2 * 1.96 * 3 / 20, rel=0.2)


def test_shares_are_of_the_oracle_under_the_same_preset(tmp_path: Path) -> None:
    good = score([EpisodeResult(20.0, 150, 10, True)])
    half = score([EpisodeResult(10.0, 300, 5, False)])
    none = score([EpisodeResult(-1.0, 167, 0, False)])
    lines = [Line("servo", "dim", half), Line("oracle", "dim", good), Line("x", "late", none)]
    assert share_of_oracle(lines[0], lines) == 0.5
    assert share_of_oracle(lines[2], lines) is None
    draw(lines, tmp_path / "bars.png", trial(1, stage="10"))
    assert (tmp_path / "bars.png").read_bytes().startswith(b"\x89PNG")


invoke = partial(output_of, command)


@pytest.mark.slow
def test_the_command_prints_json_and_a_table() -> None:
    options = ["--lesson", "1", "--episodes", "2", "--made-up-rooms", "1", "--workers", "1"]
    servo, oracle = json.loads(invoke("servo", "oracle", *options, "--json"))
    assert (servo["contestant"], servo["preset"], servo["episodes"]) == ("servo", "nominal", 2)
    assert oracle["share_of_oracle"] == 1.0
    assert oracle["reward"]["low"] <= oracle["reward"]["mean"] <= oracle["reward"]["high"]
    (ball,) = json.loads(
        invoke("oracle", *options, "--object", "models/objects/green-ball.toml", "--json")
    )
    assert ball["touches"]["mean"] == 1
    table = invoke("oracle", *options, "--preset", "slippery")
    assert "slippery" in table
    assert "100 %" in table


def test_every_policy_is_looked_at_before_the_first_drives(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def drives(*_: object) -> None:
        raise AssertionError("it drives")

    monkeypatch.setattr("mbot_workstation.learn.evaluation.episodes.evaluate", drives)
    with pytest.raises(ConfigurationError, match="no policy"):
        invoke("servo", str(tmp_path / "none.onnx"))


def test_the_command_names_what_is_wrong(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="no policy"):
        driver(str(tmp_path / "none.onnx"), 1, 0, preset("nominal"))
    for options, message in (
        (("servo", "--lesson", "11"), "--lesson"),
        (("servo", "--preset", "perfect"), "--preset"),
    ):
        with pytest.raises(ConfigurationError, match=message):
            invoke(*options)


@pytest.mark.slow
def test_a_film_shows_all_contestants_side_by_side_until_the_last_has_ended(tmp_path: Path) -> None:
    path = tmp_path / "film.mp4"
    decisions = film_episode({"oracle": "oracle", "chance": "random"}, trial(1, stage="1"), path)
    film = cv2.VideoCapture(str(path))
    frames = 0
    while True:
        there, frame = film.read()
        if not there:
            break
        frames += 1
        assert frame.shape == (2 * SIDE_PX + LINE_PX, 2 * SIDE_PX, 3)
    assert frames == decisions > 5
    assert film.get(cv2.CAP_PROP_FPS) == RATE_HZ
    with pytest.raises(ConfigurationError, match="can't write a film"):
        film_episode({"oracle": "oracle"}, trial(1, stage="1"), tmp_path / "none" / "film.mp4")
