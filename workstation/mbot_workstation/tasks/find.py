"""The task that a user names: one of those here, or a file of his own."""

import hashlib
import importlib
import importlib.util
import pkgutil
import sys
import traceback
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

from mbot_protocol.did_you_mean import did_you_mean
from mbot_protocol.errors import ConfigurationError
from mbot_workstation import tasks
from mbot_workstation.tasks.episode import NOTHING
from mbot_workstation.tasks.task import Task

DEFAULT_TASK = "fetch"
RESERVED = ("reward", "ended", "happening", "lesson", "episode", "terminal_observation")
"""Names that infos and step records have already."""

_FRAME = ("episode", "find", "floor", "lesson", "sight", "task")


def task_names() -> tuple[str, ...]:
    """Of the tasks that ship."""
    found = (module.name for module in pkgutil.iter_modules(tasks.__path__))
    return tuple(name for name in found if name not in _FRAME)


def full_reference(reference: str) -> str:
    """The same from every folder: a file with its whole path."""
    return str(Path(reference).resolve()) if is_file(reference) else reference


def find_task(reference: str = DEFAULT_TASK) -> Task:
    """A task by its name, or by the path of a file, which is run: give your own only.

    Raises:
        ConfigurationError: there is none, or the file is none.

    """
    return _found(full_reference(reference))


def task_digest(reference: str) -> str:
    """SHA-256 of a task's file and what it imports from beside it, or of the folder that ships."""
    find_task(reference)
    if is_file(reference):
        path = Path(reference).resolve()
        own = _module_name(path)
        beside = [str(m.__file__) for name, m in sys.modules.items() if name.startswith(f"{own}.")]
        files = [path, *map(Path, sorted(beside))]
    else:
        home = Path(tasks.__path__[0], reference)
        files = sorted(home.glob("*.py")) if home.is_dir() else [home.with_suffix(".py")]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


def is_file(reference: str) -> bool:
    """Whether finding this task runs a user's file."""
    return reference.endswith(".py")


@cache
def _found(reference: str) -> Task:
    if is_file(reference):
        module = _load(Path(reference))
    elif reference in (names := task_names()):
        package = f"{tasks.__name__}.{reference}"
        module = importlib.import_module(package)
        if hasattr(module, "__path__"):
            module = importlib.import_module(f"{package}.task")
    else:
        raise ConfigurationError(
            f"no task {reference!r}, expected one of {', '.join(names)}, or a file "
            f"NAME.py{did_you_mean(reference, names)}"
        )
    if (task := getattr(module, "TASK", None)) is None:
        raise ConfigurationError(f"{reference} names no TASK: it is a task's file once it has one")
    if fault := _fault(task):
        raise ConfigurationError(f"{reference}: {fault}")
    return task


def _fault(task: Any) -> str:
    """What keeps this from being a task, if anything does."""
    if Task not in type(task).__mro__:
        return f"TASK is a {type(task).__name__}, expected an object of a class derived from Task"
    missing = [name for name in Task.__annotations__ if not hasattr(task, name)]
    if missing:
        return f"its TASK has no {', '.join(missing)}"
    facts = task.facts.names or ()
    if taken := [name for name in facts if name in RESERVED]:
        return f"a fact is called {taken[0]}, which the environment has already; call it otherwise"
    if unknown := [
        name
        for name in (task.counted, *task.critic, *task.mistakes, *task.terms)
        if name not in facts
    ]:
        return f"counted, critic, mistakes and terms name {', '.join(unknown)}, no fact of it"
    if not task.happenings or task.happenings[0] != NOTHING:
        return f"the first of its happenings is to be {NOTHING!r}"
    names = [lesson.name for lesson in task.lessons]
    if not names or len(set(names)) < len(names):
        return "it needs at least one lesson, and each a name of its own"
    return ""


def _module_name(path: Path) -> str:
    return f"mbot_task_{path.stem}_{hashlib.sha256(str(path).encode()).hexdigest()[:8]}"


def _load(path: Path) -> ModuleType:
    """Run a user's file. Its classes have a module's name, so that other processes know them; to
    what lies beside it, `from .other import ...`, it is as a package, so that other tasks' files of
    these names are none of its.
    """
    name = _module_name(path)
    beside = [str(path.parent)]
    spec = importlib.util.spec_from_file_location(name, path, submodule_search_locations=beside)
    if spec is None or spec.loader is None or not path.is_file():
        raise ConfigurationError(f"no file {path}")
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:  # whatever a user's code raises
        for mine in [one for one in sys.modules if one == name or one.startswith(f"{name}.")]:
            del sys.modules[mine]
        wrong = f"{path} can't be run: {type(error).__name__}: {error}"
        missing = (isinstance(error, ModuleNotFoundError) and error.name) or ""
        if (path.parent / f"{missing}.py").is_file():
            wrong += f"; import what lies beside it by `from .{missing} import ...`"
        raise ConfigurationError(wrong) from None
    return module


def mistake_in(reference: str, error: Exception) -> ConfigurationError | None:
    """An exception of a user's file, or of one beside it, as its author reads it; None if it comes
    from elsewhere.
    """
    if not is_file(reference):
        return None
    folder = Path(reference).parent
    frames = traceback.extract_tb(error.__traceback__)
    mine = [frame for frame in frames if Path(frame.filename).parent == folder]
    if not mine:
        return None
    where = f"{mine[-1].filename}:{mine[-1].lineno}"
    return ConfigurationError(f"{where}: {type(error).__name__}: {error}")
