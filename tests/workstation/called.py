"""A command of `workstation`, called in this process as a terminal would call it."""

from collections.abc import Callable
from pathlib import Path

import typer
from typer.testing import CliRunner, Result


def called(command: Callable[..., None], *arguments: str | Path) -> Result:
    """What came of it; an error that it raised is in there."""
    app = typer.Typer()
    app.command()(command)
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def output_of(command: Callable[..., None], *arguments: str | Path) -> str:
    """What it says; an error that it raises is raised here."""
    result = called(command, *arguments)
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.output
