"""The policy that ships drives as its pages in docs/results say.

Pages of another policy say nothing of it: tests/test_results_pages.py names those.
"""

import hashlib
import re
from pathlib import Path

import pytest

from mbot_workstation.learn.evaluation.episodes import Trial, evaluate, score
from mbot_workstation.learn.studies.study_plans import study_plan
from mbot_workstation.learn.worlds.rooms import evaluation_rooms
from mbot_workstation.sim.effects.presets import preset
from mbot_workstation.tasks.fetch.task import TASK
from mbot_workstation.tasks.lesson import lesson_named

pytestmark = pytest.mark.slow

CHECKOUT = Path(__file__).parents[2]
SHIPPED = str(CHECKOUT / "models" / "red-cube.onnx")
ROW = r"^\| {} \| ([\d.]+) \(([\d.]+) to ([\d.]+)\) \|"
"""Of a preset: the reward with its interval, the policy's first."""


def page_of_this_policy(name: str) -> str:
    text = (CHECKOUT / "docs" / "results" / name).read_text()
    if hashlib.sha256(Path(SHIPPED).read_bytes()).hexdigest()[:12] not in text:
        pytest.skip(f"{name} is of another policy")
    return text


@pytest.mark.parametrize("name", ["nominal", "handicap", "late", "any-room"])
def test_it_is_as_good_as_its_page_says(name: str) -> None:
    """The same episodes; another processor's rounding moves some by a decision."""
    presets = page_of_this_policy("lesson-10.md").partition("--preset all")[2]
    found = re.search(ROW.format(name), presets, re.M)
    asked = re.match(r" --episodes (\d+)", presets)
    assert found is not None
    assert asked is not None
    mean, low, high = map(float, found.groups())
    trial = Trial(
        lesson_named(TASK.lessons, "10"), preset(name), evaluation_rooms([]), episodes=int(asked[1])
    )
    reward = score(evaluate(SHIPPED, trial)).reward.mean
    assert low <= reward <= high, f"the page says {mean}"


def test_it_is_no_worse_than_the_paper() -> None:
    trial = Trial(
        lesson_named(TASK.lessons, "10"),
        preset("nominal"),
        evaluation_rooms([]),
        episodes=32,
        seed=1,
    )
    assert score(evaluate(SHIPPED, trial)).reward.mean >= 19.8


def test_it_bears_pictures_as_late_as_the_papers() -> None:
    """All of the page's episodes at 400 ms; README says 19.8."""
    page = page_of_this_policy("latency.md")
    found = re.search(ROW.format(r"400 ms \| red-cube"), page, re.M)
    assert found is not None
    mean, low, high = map(float, found.groups())
    (late,) = [one for one in study_plan("latency").conditions if one.label == "400 ms"]
    trial = Trial(lesson_named(TASK.lessons, "10"), late.effects, evaluation_rooms([]), episodes=50)
    reward = score(evaluate(SHIPPED, trial)).reward.mean
    assert low <= reward <= high, f"the page says {mean}"
