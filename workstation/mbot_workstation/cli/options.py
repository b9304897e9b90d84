"""Commands that take their options as one frozen dataclass: each option is a field of it."""

import contextlib
import dataclasses
import functools
import inspect
import os
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_type_hints

import typer

from mbot_protocol.early_interrupt import ctrl_c_as_usual
from mbot_protocol.errors import ConfigurationError, InterruptedByUserError
from mbot_protocol.files.git_lfs import POINTER, refuse_pointer
from mbot_workstation.cli.presenter import Answer, present

Options = TypeVar("Options")

_TYPER, _CHECK = "typer", "check"

PICTURES = (".png", ".svg", ".pdf")
"""What figures can be written as."""


def option(default: Any, help_text: str, *names: str, panel: str = "", **settings: Any) -> Any:
    """A field that is an option; what isn't said here is what typer makes of the field.

    Args:
        default: its value where the option is not given.
        help_text: one or two sentences, with units.
        names: such as "--output", "-o"; made from the field's name if there are none.
        panel: the group that it is shown in.
        settings: of `typer.Option`, such as metavar, min, max, envvar.

    """
    made = typer.Option(*names, help=help_text, rich_help_panel=panel or None, **settings)
    return dataclasses.field(default=default, metadata={_TYPER: made})


def output_file(
    default: Path | None,
    help_text: str,
    *names: str,
    endings: tuple[str, ...] = (),
    **settings: Any,
) -> Any:
    """An option that names a file to write, looked at before the command begins.

    Args:
        default, help_text, names, settings: as of `option`.
        endings: one of which the file must have; any if empty.

    """
    made = option(default, help_text, *names, **settings)
    check = functools.partial(check_output_file, endings=endings)
    return dataclasses.field(default=default, metadata={**made.metadata, _CHECK: check})


def output_folder(default: Path | None, help_text: str, *names: str, **settings: Any) -> Any:
    """As `output_file`, for a folder, which is made if need be."""
    made = option(default, help_text, *names, **settings)
    metadata = {**made.metadata, _CHECK: check_output_folder}
    return dataclasses.field(default=default, metadata=metadata)


def argument(help_text: str, default: Any = dataclasses.MISSING, **settings: Any) -> Any:
    """A field that is a positional argument; required unless it has a default."""
    made = typer.Argument(help=help_text, **settings)
    return dataclasses.field(default=default, metadata={_TYPER: made})


def check_output_file(path: Path, name: str, endings: tuple[str, ...] = ()) -> None:
    """Check that a file can be written.

    Args:
        path: of the file.
        name: of the option that named it, such as --result.
        endings: one of which it must have; any if empty.

    Raises:
        ConfigurationError: it is a folder, its folder is missing or closed, or its ending unknown.

    """
    folder = path.absolute().parent
    if path.is_dir():
        raise ConfigurationError(f"{name} is {path}, which is a folder; expected a file's name")
    if endings and path.suffix.lower() not in endings:
        raise ConfigurationError(
            f"{name} is {path}, expected a name that ends in {' or '.join(endings)}"
        )
    if not folder.is_dir():
        raise ConfigurationError(
            f"{name} is {path}, but there is no folder {folder}: make it first"
        )
    if not os.access(path if path.exists() else folder, os.W_OK):
        raise ConfigurationError(f"{name} is {path}, which you may not write")


def check_new_file(path: Path) -> None:
    """Check that nothing is overwritten; raises ConfigurationError."""
    if path.exists():
        raise ConfigurationError(f"{path} exists already; choose another name")


def check_output_folder(path: Path, name: str) -> None:
    """Check that a folder can be made or written into; raises as `check_output_file`."""
    there = path.absolute()
    while not there.exists():
        there = there.parent
    if not there.is_dir():
        raise ConfigurationError(f"{name} is {path}, but {there} is a file; expected a folder")
    if not os.access(there, os.W_OK):
        raise ConfigurationError(f"{name} is {path}, but you may not write into {there}")


def _refuse_pointer(given: object) -> None:
    """Whatever a command reads, of whatever kind, is looked at before anybody tries to read it."""
    if isinstance(given, str | Path):
        with contextlib.suppress(OSError):  # whoever reads it says why it can't be
            path = Path(given)
            if path.is_file():
                with path.open("rb") as file:
                    refuse_pointer(path, file.read(len(POINTER)))


def with_options(command: Callable[[Options], Answer | None]) -> Callable[..., None]:
    """A command for typer, from a function that takes a dataclass of options.

    What the function answers is presented; one that has said all itself answers nothing.
    """
    (name,) = inspect.signature(command).parameters
    kind: type[Any] = get_type_hints(command)[name]
    hints = get_type_hints(kind)

    @functools.wraps(command)
    def run(**values: Any) -> None:
        ctrl_c_as_usual()
        for field in dataclasses.fields(kind):
            _check(field, values.get(field.name))
        try:
            answer = command(kind(**values))
            if answer is not None:
                present(answer, as_json=values.get("as_json", False))
        except KeyboardInterrupt:
            raise InterruptedByUserError("interrupted") from None

    parameters = [
        inspect.Parameter(
            field.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=inspect.Parameter.empty
            if field.default is dataclasses.MISSING
            else field.default,
            annotation=Annotated[hints[field.name], field.metadata[_TYPER]],
        )
        for field in dataclasses.fields(kind)
    ]
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {p.name: p.annotation for p in parameters}
    del run.__wrapped__  # or typer would look at the function behind
    return run


def _check(field: dataclasses.Field[Any], value: Any) -> None:
    """What is to be written can be, and what is to be read is no pointer to the file."""
    check = field.metadata.get(_CHECK)
    if check is None:
        for given in value if isinstance(value, list | tuple) else (value,):
            _refuse_pointer(given)
    elif value is not None:
        check(value, "--" + field.name.replace("_", "-"))
