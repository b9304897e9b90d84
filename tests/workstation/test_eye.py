import threading
from collections.abc import Iterator

import numpy as np
import pytest
import torch

from mbot_workstation.learn.learning import eye
from mbot_workstation.learn.learning.eye import take_stills, teach_eye
from mbot_workstation.learn.learning.network import PictureNetwork
from mbot_workstation.learn.learning.residual_network import ResidualNetwork
from mbot_workstation.learn.learning.views import take_views
from mbot_workstation.learn.worlds.task_env import observation_space
from mbot_workstation.learn.worlds.task_vec_env import TaskVecEnv
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.effects.presets import NOMINAL
from mbot_workstation.sim.scene.room_generator import generate_room
from mbot_workstation.tasks.episode import Guide
from mbot_workstation.tasks.fetch.episode import IN_VIEW_RAD
from mbot_workstation.tasks.fetch.sight import FetchSight
from mbot_workstation.tasks.fetch.task import TASK
from mbot_workstation.tasks.sight import Sight


@pytest.fixture(scope="module")
def environment() -> Iterator[TaskVecEnv]:
    room = generate_room(0, 256)
    with TaskVecEnv(4, preset="ideal", lesson="10", rooms=[room], workers=2) as made:
        yield made


def guide_for(robots: int) -> Guide | None:
    return TASK.guide(robots, NOMINAL, RobotParameters(), 0)


def test_a_survey_shows_what_its_facts_say(environment: TaskVecEnv) -> None:
    found = list(environment.survey(200))
    pictures = np.concatenate([seen for seen, _ in found])
    facts = np.concatenate([told for _, told in found])
    assert pictures.shape == (200, 64, 64, 3)
    sight: Sight = FetchSight()
    sights = sight.shown(facts)
    shown = sights[:, 0] > 0
    assert 0.3 < shown.mean() < 0.8
    assert (np.abs(facts["seen_left_rad"][shown]) <= IN_VIEW_RAD).all()
    light = pictures.astype(int)
    red = (light[..., 0] - light[..., 1:].max(axis=-1)) > 60
    columns = np.arange(64)[None] * np.ones((len(red), 1))
    large = red.sum(axis=(1, 2)) > 8
    assert large[shown].mean() > 0.8
    outside = np.abs(facts["seen_left_rad"]) > 1.2 * IN_VIEW_RAD
    assert large[outside].mean() < 0.12, "a near one is larger than its middle's direction"
    clear = shown & large
    middle = (red.sum(axis=1) * columns).sum(axis=1)[clear] / red.sum(axis=(1, 2))[clear]
    assert np.corrcoef(middle, -sights[clear, 1])[0, 1] > 0.9, "left is left"


def test_robots_drive_after_a_survey_as_before(environment: TaskVecEnv) -> None:
    def rewards() -> list[float]:
        environment.seed(5)
        environment.reset()
        wheels = np.full((4, 2), 0.5, np.float32)
        return [float(environment.step(wheels)[1].sum()) for _ in range(4)]

    before = rewards()
    list(environment.survey(40))
    assert rewards() == before


def test_an_eye_learns_to_see(environment: TaskVecEnv, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(eye, "ROUND", 1000)
    monkeypatch.setattr(eye, "EPOCHS", 12)
    torch.manual_seed(0)
    torch.set_num_threads(1)  # as a training does
    network = ResidualNetwork(observation_space())
    said: list[str] = []
    advice = teach_eye(network, environment, guide_for, 2000, threading.Event(), said.append)
    assert advice is not None
    losses = [float(line.rsplit(" ", 1)[1]) for line in said]
    views = take_views(environment, guide_for, 400, threading.Event())
    with torch.no_grad():
        wheels = advice(network(torch.from_numpy(views.pictures).float())).numpy()
    told, right = (one[:, 1] - one[:, 0] for one in (wheels, views.advice))
    assert np.corrcoef(told, right)[0, 1] > 0.6, "to which side the guide would turn"
    assert losses[1] < 0.75 * losses[0]


def test_every_other_view_is_mirrored_and_says_so(environment: TaskVecEnv) -> None:
    np.random.seed(3)
    views = take_views(environment, guide_for, 1600, threading.Event())
    light = views.pictures.astype(int)
    red = (light[..., 0] - light[..., 1:].max(axis=-1)) > 60
    clear = (views.sights[:, 0] > 0) & (red.sum(axis=(1, 2)) > 8)
    side = (red.sum(axis=1) * np.arange(64)).sum(axis=1)[clear] / red.sum(axis=(1, 2))[clear]
    left, turn = views.sights[clear, 1], views.advice[clear, 1] - views.advice[clear, 0]
    assert np.corrcoef(side, -left)[0, 1] > 0.9
    assert np.corrcoef(turn, left)[0, 1] > 0.8, "the guide turns to where the object is"
    assert 0.4 < (left > 0).mean() < 0.6
    search = views.advice[views.sights[:, 0] == 0]
    assert (search[:, 0] >= search[:, 1]).mean() > 0.95, "a search turns right, mirrored or not"


def test_stills_are_what_the_eye_sees(
    environment: TaskVecEnv, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(eye, "STILLS", 640)
    network = ResidualNetwork(observation_space())
    np.random.seed(3)
    stills = take_stills(network, environment, guide_for, 10**6, 5, threading.Event())
    assert stills.features.shape == (640, 256)
    drawn = stills.draw(50)
    assert drawn.state.shape == (50, 5)
    assert not drawn.state.any()
    assert drawn.forgot.all()
    assert np.isfinite(drawn.advice).all()
    for features, advice in zip(drawn.seen[0], drawn.advice[0], strict=True):
        (same,) = np.flatnonzero((stills.features == features).all(axis=1))[:1]
        assert np.array_equal(stills.advice[same], advice)


def test_nothing_is_learned_of_a_task_that_says_nothing(
    environment: TaskVecEnv, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(environment.task, "sight", None)
    network = PictureNetwork(observation_space())
    before = network.first.weight.clone()
    assert not teach_eye(network, environment, None, 64, threading.Event(), lambda _: None)
    assert torch.equal(network.first.weight, before)


def test_who_is_told_to_stop_stops_and_says_nothing(environment: TaskVecEnv) -> None:
    stop, said = threading.Event(), list[str]()
    stop.set()
    network = PictureNetwork(observation_space())
    assert not teach_eye(network, environment, None, 64_000, stop, said.append)
    assert said == []
