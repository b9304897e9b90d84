"""What policies are tried on: what they were trained to fetch, or what --object names."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.table import Table

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.fleet.models.trained_object import (
    TrainedObject,
    named,
    told_object,
    trained_object,
)
from mbot_workstation.learn.drivers.contestants import BUILT_IN
from mbot_workstation.learn.evaluation.evaluation_report import Line
from mbot_workstation.sim.scene.object_file import read_objects
from mbot_workstation.sim.scene.target_object import RED_CUBE, TargetObject
from mbot_workstation.tasks.task import Task


@dataclass(frozen=True, slots=True)
class ObjectTried:
    """The kinds of object of one trial, and their names in one line."""

    name: str
    kinds: tuple[TargetObject, ...]


def objects_tried(
    contestants: Mapping[str, str], files: Sequence[Path]
) -> tuple[list[ObjectTried], list[str]]:
    """The objects to try contestants on, and what a person should know of that.

    Args:
        contestants: their titles, by what `driver` takes.
        files: of --object; without any it is what the policies were trained for.

    Raises:
        ConfigurationError: a file is unusable, the policies were trained for different objects, or
            for one that can't be built from what they say.

    """
    own = {
        title: trained_object(Path(contestant))
        for contestant, title in contestants.items()
        if contestant not in BUILT_IN
    }
    if not files:
        return _trained_for(own)
    tried: list[ObjectTried] = []
    for path in files:
        kinds = read_objects(path)
        tried.append(ObjectTried(named([kind.name for kind in kinds]), kinds))
    meant = {_digest(told_object(path)) for path in files}
    names = ", ".join(one.name for one in tried)
    return tried, [
        f"{title} was trained for the {_words(thing)}, and is tried on the {names}"
        for title, thing in own.items()
        if _digest(thing) not in meant
    ]


def _trained_for(own: Mapping[str, TrainedObject | None]) -> tuple[list[ObjectTried], list[str]]:
    if len({_digest(thing) for thing in own.values()}) > 1:
        told = ", ".join(f"{title} for the {_words(thing)}" for title, thing in own.items())
        raise ConfigurationError(
            f"trained were {told}: say by --object FILE.toml what they shall fetch; given several "
            "times it makes a table of policies by objects"
        )
    thing = next(iter(own.values()), None)
    if thing is None:
        return [ObjectTried(RED_CUBE.name, (RED_CUBE,))], []
    words = f"without --object it is the {thing.words}, which {next(iter(own))} was trained for"
    return [ObjectTried(thing.words, thing.objects())], [words]


def _words(thing: TrainedObject | None) -> str:
    return RED_CUBE.name if thing is None else thing.words


def _digest(thing: TrainedObject | None) -> str:
    return "" if thing is None else thing.sha256


def object_table(tried: Sequence[tuple[str, Sequence[Line]]], title: str, task: Task) -> Table:
    """Policies by objects: what was fetched of all, a mean with its 95 % interval.

    Args:
        tried: an object's name and its lines, which are the same contestants' for each.
        title: above the table.
        task: whose counts they are.

    """
    words = f"{task.counted} an episode, 95 %; {title}"
    grid = Table(title=words, title_justify="left", box=None, padding=(0, 2, 0, 0))
    grid.add_column("preset")
    grid.add_column("contestant", overflow="fold")
    for name, _ in tried:
        grid.add_column(name, justify="right")
    for row in zip(*(lines for _, lines in tried), strict=True):
        counts = [line.score.count for line in row]
        cells = [f"{one.mean:.2f} ({one.low:.2f}-{one.high:.2f})" for one in counts]
        grid.add_row(row[0].preset, row[0].contestant, *cells)
    return grid
