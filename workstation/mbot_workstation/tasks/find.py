"""The task that a user names: one of those here, or a file of his own."""

import importlib
import importlib.util
import pkgutil
import sys
from functools import cache
from pathlib import Path
from types import ModuleType

from mbot_protocol.did_you_mean import did_you_mean
from mbot_protocol.errors import ConfigurationError
from mbot_workstation import tasks
from mbot_workstation.tasks.task import Task

DEFAULT_TASK = "fetch"
_FRAME = ("episode", "find", "lesson", "task")


def task_names() -> tuple[str, ...]:
    """Of the tasks that ship."""
    found = (module.name for module in pkgutil.iter_modules(tasks.__path__))
    return tuple(name for name in found if name not in _FRAME)


def full_reference(reference: str) -> str:
    """The same from every folder: a file with its whole path."""
    return str(Path(reference).resolve()) if reference.endswith(".py") else reference


@cache
def find_task(reference: str = DEFAULT_TASK) -> Task:
    """A task by its name, or by the path of a file, which is run: give your own only.

    Raises:
        ConfigurationError: there is none, or the file is none.

    """
    if reference.endswith(".py"):
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
    return task


def _load(path: Path) -> ModuleType:
    """Run a user's file. Its classes have a module's name, so that other processes know them."""
    name = f"mbot_task_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None or not path.is_file():
        raise ConfigurationError(f"no file {path}")
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:  # whatever a user's code raises
        del sys.modules[name]
        raise ConfigurationError(f"{path} can't be run: {type(error).__name__}: {error}") from None
    return module
