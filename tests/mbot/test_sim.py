"""The simulation as an environment, from its short name."""

import sys

import numpy as np
import pytest

from mbot import ConfigurationError
from mbot.sim import make_env
from mbot_workstation.learn.worlds.task_env import TaskEnv

from ..ran import ran


def test_a_seed_fixes_what_follows() -> None:
    seen = []
    for seed in (3, 3, 4):
        env = make_env(lesson="1", seed=seed)
        first, _ = env.reset()
        picture, reward, ended, cut_off, facts = env.step(np.array([0.5, 0.5], np.float32))
        assert (picture.shape, picture.dtype) == ((64, 64, 3), np.uint8)
        assert isinstance(facts["touches"], int | np.integer)
        seen.append((first, picture, reward, ended, cut_off))
        env.close()
    assert np.array_equal(seen[0][0], seen[1][0])
    assert np.array_equal(seen[0][1], seen[1][1])
    assert seen[0][2:] == seen[1][2:]
    assert not np.array_equal(seen[0][0], seen[2][0])


def test_it_is_the_gymnasium_environment() -> None:
    env = make_env(lesson="1", render_mode="rgb_array")
    assert isinstance(env, TaskEnv)
    first, _ = env.reset(seed=1)
    assert np.array_equal(env.render(), first)  # pyright: ignore[reportArgumentType]
    env.close()


@pytest.mark.parametrize("wrong", [{"preset": "nominall"}, {"lesson": "99"}, {"task": "fetsch"}])
def test_a_wrong_name_is_one_line(wrong: dict[str, str]) -> None:
    with pytest.raises(ConfigurationError) as error:
        make_env(**wrong)  # pyright: ignore[reportArgumentType]
    assert next(iter(wrong.values())) in str(error.value)
    assert len(str(error.value).splitlines()) == 1


def test_without_the_extra_it_says_which() -> None:
    code = "import sys; sys.modules['gymnasium'] = None; from mbot.sim import make_env; make_env()"
    done = ran(sys.executable, "-c", code)
    assert done.returncode == 1
    assert "make_env needs gymnasium; pip install" in done.stderr.splitlines()[-1]
