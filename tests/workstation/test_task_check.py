"""What a task pays for is found out before it is learned; a new one works as it is written."""

import json
import math
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from mbot_workstation.cli.tasks import check, new
from mbot_workstation.learn.evaluation import arena_plan as plan_module
from mbot_workstation.learn.evaluation import task_check
from mbot_workstation.learn.evaluation.arena_plan import LINE_PX, OBJECT, SIDE_PX, arena_plan
from mbot_workstation.learn.evaluation.cheap_strategies import WHEELS, blind_driver, guide_driver
from mbot_workstation.learn.evaluation.task_check import GUIDE, TaskCheck, check_task
from mbot_workstation.learn.worlds.task_env import TaskEnv
from mbot_workstation.sim.effects.presets import NOMINAL
from mbot_workstation.sim.scene.scene_look import Distractor
from mbot_workstation.sim.scene.scene_parameters import SceneParameters
from mbot_workstation.tasks.fetch import new_task
from mbot_workstation.tasks.fetch.task import TASK
from mbot_workstation.tasks.find import find_task, full_reference

from .called import called, output_of
from .small_world import ROOMS

CIRCLE = full_reference(str(Path(__file__).with_name("stay_in_circle.py")))
PAYS = {
    "circles": "return 2.0 * now.driven_m - 17 * (now.happening == 'touch')",
    "border": "return 50 * now.elapsed_s * (max(abs(now.robot.x_m), abs(now.robot.y_m)) > 2)",
    "shuttle": "return max(0.0, 9 * now.nearer_m) - 17 * (now.happening == 'touch')",
    "breaks": "return float('nan')",
}


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(task_check, "ROBOTS", 2)
    monkeypatch.setattr(task_check, "MOST_DECISIONS", 60)


def found(file: Path | str) -> TaskCheck:
    return check_task(full_reference(str(file)), ROOMS, 0, lambda _: None, workers=1)


@pytest.mark.usefixtures("quick")
def test_a_new_task_works_as_it_is_written(tmp_path: Path) -> None:
    file = tmp_path / "my_sprint.py"
    told = output_of(new, file)
    assert told == f"wrote {file}; next: workstation task check {file}\n"
    assert find_task(str(file)).name == "my-sprint"
    assert len(file.read_text().splitlines()) < 50
    checked = found(file)
    assert checked.faults == ()
    far = {one.driver: one for one in checked.earned if one.lesson == "far"}
    assert far.keys() == {GUIDE, *WHEELS, "random", "servo"}
    assert far[GUIDE].count > 2
    assert far[GUIDE].reward > 5 > far["standing"].reward
    assert far["standing"].by_happening == {"nothing": pytest.approx(-0.24, abs=0.02)}
    assert sum(far[GUIDE].by_happening.values()) == pytest.approx(far[GUIDE].reward, abs=0.01)
    assert 0 < (far[GUIDE].in_view or 0) < 1


def paying(folder: Path, what: str) -> Path:
    """The new task, which pays this instead."""
    text = Path(new_task.__file__).read_text()
    text = text.replace("return 0.2 * now.nearer_m", PAYS[what])
    path = folder / f"{what}.py"
    path.write_text(text)
    return path


@pytest.mark.slow
@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize(
    ("what", "who"),
    [
        ("circles", "in circles|to and fro"),
        ("border", "to the border"),
        ("shuttle", "in circles|to and fro"),
    ],
)
def test_a_reward_that_pays_for_something_cheap_is_refused(
    tmp_path: Path, what: str, who: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(task_check, "MOST_DECISIONS", 400)
    (fault,) = found(paying(tmp_path, what)).faults
    assert "that is what would be learned" in fault
    assert any(name in fault.split(" earns ")[0] for name in who.split("|"))


@pytest.mark.usefixtures("quick")
def test_what_is_no_number_is_refused(tmp_path: Path) -> None:
    result = called(check, paying(tmp_path, "breaks"), "--json")
    assert result.exit_code == 1
    told = json.loads(result.output)
    assert "has to be a finite number" in told["faults"][0]


@pytest.mark.slow
@pytest.mark.usefixtures("quick")
def test_without_a_guide_the_cheap_ones_are_told() -> None:
    checked = found(CIRCLE)
    assert "no guide" in checked.notes[0]
    assert all(one.in_view is None for one in checked.earned)


def test_wheels_are_told_again_and_again_from_each_beginning() -> None:
    driven = blind_driver("to and fro", 2)
    forward = [bool(driven.act(None, [])[0, 0] > 0) for _ in range(10)]  # pyright: ignore[reportArgumentType]
    assert forward == [True] * 4 + [False] * 4 + [True] * 2
    assert guide_driver(find_task(CIRCLE), 2, NOMINAL, 0) is None


def test_the_arena_is_drawn_with_its_object() -> None:
    plan = arena_plan("fetch", 0)
    assert plan.shape[2] == 3
    assert (plan == OBJECT).all(axis=-1).sum() > 10
    assert find_task("fetch") is TASK


@pytest.fixture
def few_rooms(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plan_module, "TaskEnv", partial(TaskEnv, rooms=ROOMS))


@pytest.mark.usefixtures("few_rooms")
@pytest.mark.parametrize("name", ["bring", "line", "obstacles", "stay"])
def test_the_arena_is_drawn_with_what_a_task_puts_into_it(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    furnished = arena_plan(name, 1)[:, :SIDE_PX].astype(int)
    task = type(find_task(name))
    monkeypatch.setattr(task, "pieces", lambda *_: ())
    bare = arena_plan(name, 1)[:, :SIDE_PX].astype(int)
    drawn = (furnished != bare).any(axis=2)
    assert drawn.sum() > 100
    if name in ("line", "stay"):
        assert (furnished[drawn] < 20).all(), "black tape"
        rows, columns = np.nonzero(drawn)
        middle = SIDE_PX / 2
        assert rows.min() < middle + LINE_PX, "ahead is up"
        assert np.ptp(columns) > 0.3 * SIDE_PX
    elif name == "bring":
        assert (furnished[drawn][:, 1] > furnished[drawn][:, 0]).all(), "a green mat"


@pytest.mark.usefixtures("few_rooms")
def test_what_is_drawn_from_above_is_where_it_stands(monkeypatch: pytest.MonkeyPatch) -> None:
    """A bar half a metre ahead and to the left, turned by an eighth."""
    bar = Distractor("box", (0.3, 0.02, 0.1), (1.0, 0.5, 0.1), math.pi / 4, (0.0, 0.0, 1.0))
    ball = Distractor("ball", (0.2, 9.0, 9.0), (-1.0, -1.0, 0.2), 0.0, (0.0, 1.0, 0.0))
    monkeypatch.setattr(type(TASK), "pieces", lambda *_: (bar, ball))
    plan = arena_plan("fetch", 0)[LINE_PX:, :SIDE_PX]
    scale = SIDE_PX / 2 / (SceneParameters().arena.border_m + 0.2)

    def spots(rgb: tuple[int, int, int]) -> np.ndarray:
        """Metres ahead and to the left of the middle."""
        rows, columns = np.nonzero((plan == rgb).all(axis=2))
        return np.stack([SIDE_PX / 2 - rows, SIDE_PX / 2 - columns], axis=1) / scale

    blue, green = spots((0, 0, 255)), spots((0, 255, 0))
    np.testing.assert_allclose(blue.mean(axis=0), (1.0, 0.5), atol=0.03)
    np.testing.assert_allclose(np.ptp(blue, axis=0), 2 * 0.32 * math.sqrt(0.5), atol=0.06)
    assert np.corrcoef(blue.T)[0, 1] > 0.9, "turned to the left"
    np.testing.assert_allclose(green.mean(axis=0), (-1.0, -1.0), atol=0.03)
    np.testing.assert_allclose(np.ptp(green, axis=0), 0.4, atol=0.06)


def test_a_file_is_written_once_and_has_a_name_that_can_be_a_tasks(tmp_path: Path) -> None:
    output_of(new, tmp_path / "one.py")
    for name, wrong in (("one.py", "exists already"), ("../a b.py", "no name for a task")):
        error = called(new, tmp_path / name).exception
        assert error is not None
        assert wrong in str(error)
    gone = called(new, tmp_path / "none" / "two.py").exception
    assert "can't write" in str(gone)
