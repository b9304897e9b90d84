"""What a command has found, as a person or a program reads it; and how far it is meanwhile."""

import json
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import typer

from mbot_protocol.errors import MbotError

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.progress import Progress
    from rich.table import Table

PIPE_COLUMNS = 200
"""Into a pipe no cell shall be broken."""


@dataclass(frozen=True, slots=True)
class Answer:
    """What a command has found.

    Attributes:
        value: a frozen struct, or a list or mapping of such: with --json its fields are printed.
        said: the same for a person, lines and tables; made only if one reads.
        notes: on standard error, in both forms.
        exit_code: unless there is an error.
        error: raised when all else has been said.

    """

    value: Any
    said: "Iterable[RenderableType]" = ()
    notes: Iterable[str] = ()
    exit_code: int = 0
    error: MbotError | None = None


def present(answer: Answer, *, as_json: bool) -> None:
    """Print an answer, and raise what it ends with."""
    for words in answer.notes:
        note(words)
    if as_json:
        print(json.dumps(plain(answer.value), indent=2 if sys.stdout.isatty() else None))
    else:
        for part in answer.said:
            if isinstance(part, str):
                print(part)
            else:
                _show(part)
    if answer.error is not None:
        raise answer.error
    if answer.exit_code:
        raise typer.Exit(answer.exit_code)


def plain(value: Any) -> Any:
    """Structs, dataclasses, paths and arrays as JSON takes them."""
    import msgspec

    return msgspec.to_builtins(value, enc_hook=_of_foreign_type)


def _of_foreign_type(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else str(value)


def _show(part: "RenderableType") -> None:
    from rich.console import Console

    console = Console()
    console.print(part, width=None if console.is_terminal else PIPE_COLUMNS)


def note(words: str) -> None:
    """Beside the result: on standard error."""
    print(f"workstation: note: {words}", file=sys.stderr)


def table(
    headings: Sequence[str], rows: Iterable[Sequence[str]], right: Collection[str] = ()
) -> "Table":
    """A table of cells printed as they are; columns named in `right` are flush right."""
    from rich.markup import escape
    from rich.table import Table

    made = Table(box=None, padding=(0, 2, 0, 0), show_header=any(headings))
    for heading in headings:
        made.add_column(heading, justify="right" if heading in right else "left")
    for row in rows:
        made.add_row(*map(escape, row))
    return made


@contextmanager
def working(words: str, total: float) -> Iterator[Callable[[float], None]]:
    """A bar for what takes long, to be told how much is done; on stderr, gone when it ends."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(words, total=total)
        yield lambda done: progress.update(task, completed=done)


def transfer_bar() -> "Progress":
    """A bar for what is sent to a robot: bytes, speed, and words beside it; as `working`."""
    from rich.console import Console
    from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TransferSpeedColumn

    console = Console(stderr=True)
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        DownloadColumn(),
        TransferSpeedColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )
