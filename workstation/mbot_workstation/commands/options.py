"""Commands that take their options as one frozen dataclass: each option is a field of it."""

import dataclasses
import functools
import inspect
from collections.abc import Callable
from typing import Annotated, Any, TypeVar, get_type_hints

import typer

Options = TypeVar("Options")

_TYPER = "typer"


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


def argument(help_text: str, default: Any = dataclasses.MISSING, **settings: Any) -> Any:
    """A field that is a positional argument; required unless it has a default."""
    made = typer.Argument(help=help_text, **settings)
    return dataclasses.field(default=default, metadata={_TYPER: made})


def with_options(command: Callable[[Options], None]) -> Callable[..., None]:
    """A command for typer, from a function that takes a dataclass of options."""
    (name,) = inspect.signature(command).parameters
    kind: type[Any] = get_type_hints(command)[name]
    hints = get_type_hints(kind)

    @functools.wraps(command)
    def run(**values: Any) -> None:
        command(kind(**values))

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
