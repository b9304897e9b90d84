"""The study of what a policy bears: maps over pairs of deviations, as page, picture and numbers."""

from collections.abc import Callable, Sequence
from pathlib import Path

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files import atomic_file
from mbot_workstation.learn.evaluation.episodes import Trial
from mbot_workstation.learn.evaluation.evaluation_report import Line
from mbot_workstation.learn.studies.study_plans import PAIRS
from mbot_workstation.learn.studies.study_report import make_folder
from mbot_workstation.learn.studies.study_run import Condition
from mbot_workstation.learn.studies.tolerance_file import (
    TOLERANCE_FILE,
    HomeMistakes,
    write_tolerances,
)
from mbot_workstation.learn.studies.tolerance_map import (
    ToleranceMap,
    as_file,
    draw_maps,
    map_page,
)
from mbot_workstation.sim.effects.effects import EffectRanges


def pairs_named(given: Sequence[str], cells: int) -> list[ToleranceMap]:
    """Maps over the deviations that --pair names, such as track_scale:fov_scale; the usual ones if
    none are given.

    Raises:
        ConfigurationError: they are no pairs, or there is no such deviation.

    """
    names = [tuple(text.split(":")) for text in given] if given else list(PAIRS)
    if any(len(two) != 2 for two in names):
        raise ConfigurationError(
            f"--pair is {list(given)}, expected two names such as track_scale:fov_scale"
        )
    return [ToleranceMap.of(across, up, cells) for across, up in names]


def map_tolerances(
    contestant: str,
    maps: Sequence[ToleranceMap],
    trial: Trial,
    run: Callable[[Sequence[Condition], Sequence[str]], list[Line]],
    folder: Path,
    how: str,
    homes: EffectRanges | None = None,
) -> list[Path]:
    """Try a policy all over the maps, and write what came out.

    Args:
        contestant: a policy.
        maps: at least one.
        trial: on the nominal robot.
        run: tries drivers under conditions.
        folder: made if need be.
        how: one line on how it was tried.
        homes: the nominal robot in homes, to count a task's mistakes there; None does not.

    Returns:
        The files: the numbers, if there is anything that could be tolerated, and the page.

    Raises:
        ConfigurationError: the folder can't be written.

    """
    make_folder(folder)
    (nominal,) = run([Condition("nominal", trial.preset)], [contestant])
    reward = nominal.score.reward.mean
    found = [(one, one.rewards(run(one.conditions(trial.preset), [contestant]))) for one in maps]
    mistakes = () if homes is None else _mistakes(run([Condition("homes", homes)], [contestant])[0])
    picture, page = folder / "tolerance.png", folder / "tolerance.md"
    draw_maps(found, picture, nominal_reward=reward, largest=trial.lesson.largest_reward)
    text = map_page(found, nominal.contestant, reward, how, picture.name, mistakes)
    atomic_file.save(page, text.encode())
    if reward <= 0:
        return [page]
    numbers = as_file(found, nominal.contestant, reward, how, mistakes)
    return [write_tolerances(folder / TOLERANCE_FILE, numbers), page]


def _mistakes(line: Line) -> tuple[HomeMistakes, ...]:
    return tuple(
        HomeMistakes(name, one.mean, one.low, one.high, line.score.episodes)
        for name, one in line.score.mistakes.items()
    )
