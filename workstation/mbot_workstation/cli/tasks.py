"""`workstation task`: write a task of your own, and find out what it pays for."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.common_options import json_option
from mbot_workstation.cli.options import argument, option, output_file, with_options
from mbot_workstation.cli.presenter import Answer, working
from mbot_workstation.wording import typed

if TYPE_CHECKING:
    from mbot_workstation.learn.evaluation.task_check import TaskCheck

app = typer.Typer(
    help="Write a task of your own, and find out what its rewards pay for.",
    no_args_is_help=True,
    rich_markup_mode="markdown",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class NewTaskOptions:
    """What `new` takes."""

    file: Path = argument("To be written; its name becomes the task's.", metavar="NAME.py")
    as_json: bool = json_option()


@dataclass(frozen=True, slots=True)
class TaskWritten:
    """A task's file, and its name."""

    path: Path
    task: str


@app.command()
@with_options
def new(options: NewTaskOptions) -> Answer:
    """Write a task that works, in a file to change: the paper's, with rewards of its own.

    Example: `workstation task new sprint.py`
    """
    from mbot_workstation.tasks.fetch import new_task

    path = options.file.with_suffix(".py")
    name = path.stem.replace("_", "-")
    if not name.replace("-", "").isalnum() or not path.stem.isascii():
        raise ConfigurationError(
            f"{path.name} is no name for a task: letters, digits and _, such as sprint.py"
        )
    text = Path(new_task.__file__).read_text(encoding="utf-8")
    text = text.replace("FILE.py", path.name).replace('name = "new-task"', f'name = "{name}"')
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise ConfigurationError(f"{path} exists already: give another name") from None
    except OSError as error:
        raise ConfigurationError(f"can't write {path}: {error.strerror}") from None
    said = f"wrote {path}; next: workstation task check {typed(path)}"
    return Answer(TaskWritten(path, name), [said])


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckTaskOptions:
    """What `check` takes."""

    task: str = argument("By its name or file, which is run: give your own only.", metavar="TASK")
    output: Path | None = output_file(
        None,
        "Draw its arena from above, and as the robot sees it first.",
        "--output",
        "-o",
        endings=(".png", ".jpg"),
        metavar="FILE.png",
    )
    seed: int = option(0, "Of robots, rooms and objects.")
    as_json: bool = json_option()


@app.command()
@with_options
def check(options: CheckTaskOptions) -> Answer:
    """Find out, in about a minute, what cheap strategies earn beside the task's guide.

    Standing, spinning, driving in circles, full ahead, backwards, to the border, to and fro, a
    random driver and the colour servo drive 16 episodes of the last lesson each, the guide of all.
    Where one that looks at nothing earns as much as the guide, that is what a policy would learn:
    then the exit code is 1.

    Examples:

    - `workstation task check sprint.py -o arena.png`
    - `workstation task check fetch --json`
    """
    from mbot_workstation.learn.evaluation.arena_plan import arena_plan
    from mbot_workstation.learn.evaluation.task_check import check_task, trials_of
    from mbot_workstation.learn.worlds.rooms import evaluation_rooms
    from mbot_workstation.pictures.picture_file import write_picture
    from mbot_workstation.tasks.find import find_task, full_reference

    reference = full_reference(options.task)
    task = find_task(reference)
    rooms = evaluation_rooms([], 2)
    if options.output is not None:
        write_picture(options.output, arena_plan(reference, options.seed))
    with working(f"trying {task.name}", len(trials_of(task))) as tried:
        found = check_task(reference, rooms, options.seed, tried)
    said = [*_words(found, options.task)]
    if options.output is not None:
        said.insert(-1, f"wrote {options.output}")
    return Answer(found, said, exit_code=1 if found.faults else 0)


def _words(found: "TaskCheck", reference: str) -> Iterator[str]:
    yield f"{'driver':<14}{'lesson':<9}{'reward':>8} {'+-':>5}  decisions  of what"
    for one in found.earned:
        parts = ", ".join(f"{what} {share:+.2f}" for what, share in one.by_happening.items())
        seen = "" if one.in_view is None else f"; in view {one.in_view:.0%}"
        yield (
            f"{one.driver:<14}{one.lesson:<9}{one.reward:>8.2f} {one.spread:>5.2f}"
            f"{one.decisions:>11.0f}  {parts or 'nothing'}{seen}"
        )
    yield from (f"note: {note}" for note in found.notes)
    if found.faults:
        yield from (f"refused: {fault}" for fault in found.faults)
    else:
        yield (
            f"{found.task} pays for what it is meant for; next: workstation train --name "
            f"{typed(found.task)} --task {typed(reference)}"
        )
