"""`workstation recordings`: the drives that a robot has recorded."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from mbot_workstation.cli.link_options import LinkOptions, json_option
from mbot_workstation.cli.options import argument, option, with_options

if TYPE_CHECKING:
    from mbot_protocol.v1.recordings_pb2 import ListedDrive, RecordingList

app = typer.Typer(help="The drives that a robot has recorded.", no_args_is_help=True)

_WHICH = "Its number, its name or the beginning of it, or 'last'"


def _drives_argument(default: Any = None) -> Any:
    given = {} if default is None else {"default": default}
    return argument(f"Which drives. {_WHICH}.", metavar="DRIVE...", **given)


@dataclass(frozen=True, slots=True, kw_only=True)
class ListOptions(LinkOptions):
    """What `recordings list` takes."""

    as_json: bool = json_option()


@app.command("list")
@with_options
def list_command(options: ListOptions) -> None:
    """List the drives that a robot has recorded, newest first.

    Example: `workstation recordings list --robot mbot-1.local`
    """
    from mbot_workstation.fleet.link.recording_fetch import list_recordings

    with options.link() as link:
        _show(list_recordings(link), options.as_json)


@dataclass(frozen=True, slots=True, kw_only=True)
class FetchOptions(LinkOptions):
    """What `recordings fetch` takes."""

    drives: list[str] = _drives_argument(("last",))
    into: Path = option(
        Path("drives"), "Folder in which ROBOT/DRIVE is made.", "--into", metavar="FOLDER"
    )
    everything: bool = option(False, "All drives that the robot has.", "--all")
    as_json: bool = json_option()


@app.command("fetch")
@with_options
def fetch_command(options: FetchOptions) -> None:
    """Bring recorded drives here; an interrupted fetch goes on where it was.

    The robot may be driving meanwhile. What comes is compared with what the robot has by its
    SHA-256.

    Example: `workstation recordings fetch 12 --robot mbot-1.local`
    """
    import json

    from mbot_workstation.fleet.link.recording_fetch import choose, fetch, list_recordings
    from mbot_workstation.wording import size_words

    with options.link() as link:
        there = list(list_recordings(link).drives)
        wanted = there if options.everything else [choose(there, one) for one in options.drives]
        folders = [fetch(link, drive, options.into, _progress(drive.name)) for drive in wanted]
    if options.as_json:
        print(json.dumps([str(folder) for folder in folders]))
        return
    for folder, drive in zip(folders, wanted, strict=True):
        print(f"{folder}  {size_words(sum(file.size_bytes for file in drive.files))}")


@dataclass(frozen=True, slots=True, kw_only=True)
class KeepOptions(LinkOptions):
    """What `recordings keep` takes."""

    drives: list[str] = _drives_argument()
    kept: bool = option(True, "Set or clear the mark.", "--yes/--no")
    as_json: bool = json_option()


@app.command("keep")
@with_options
def keep_command(options: KeepOptions) -> None:
    """Mark drives so that the robot keeps them, whatever their age and however little room.

    Example: `workstation recordings keep last --robot mbot-1.local`
    """
    from mbot_workstation.fleet.link.recording_fetch import choose, keep, list_recordings

    with options.link() as link:
        found = list_recordings(link)
        for name in [choose(list(found.drives), one).name for one in options.drives]:
            found = keep(link, name, kept=options.kept)
    _show(found, options.as_json)


@dataclass(frozen=True, slots=True, kw_only=True)
class RemoveOptions(LinkOptions):
    """What `recordings remove` takes."""

    drives: list[str] = _drives_argument()
    as_json: bool = json_option()


@app.command("remove")
@with_options
def remove_command(options: RemoveOptions) -> None:
    """Remove drives from the robot for good.

    Example: `workstation recordings remove 12 --robot mbot-1.local`
    """
    from mbot_workstation.fleet.link.recording_fetch import choose, list_recordings, remove

    with options.link() as link:
        found = list_recordings(link)
        for name in [choose(list(found.drives), one).name for one in options.drives]:
            found = remove(link, name)
    _show(found, options.as_json)


def _progress(name: str) -> Any:
    """Bytes on stderr, where a person looks at it."""
    import sys

    def tell(here: int, whole: int) -> None:
        if sys.stderr.isatty():
            end = "\n" if here == whole else ""
            print(f"\r{name}: {here / 1e6:.1f} of {whole / 1e6:.1f} MB", end=end, file=sys.stderr)

    return tell


def _fields(drive: "ListedDrive") -> dict[str, Any]:
    return {
        "name": drive.name,
        "started_unix_time_ns": drive.started_unix_time_ns,
        "ended_unix_time_ns": drive.ended_unix_time_ns,
        "size_bytes": sum(file.size_bytes for file in drive.files),
        "files": [file.name for file in drive.files],
        "kept": drive.kept,
        "open": drive.open,
    }


def _show(found: "RecordingList", as_json: bool) -> None:
    import json
    from datetime import datetime

    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from mbot_workstation.wording import one_line, size_words

    fields = [_fields(drive) for drive in found.drives]
    if as_json:
        print(json.dumps(fields, indent=2))
        return
    if not fields:
        why = "" if found.enabled else " and records none: [recording] enabled in its configuration"
        print(f"the robot keeps no recordings{why}")
        return
    table = Table(box=None, padding=(0, 2, 0, 0))
    for heading in ("", "drive", "began", "lasted", "size"):
        table.add_column(heading)
    for drive in fields:
        began_s, ended_s = drive["started_unix_time_ns"] / 1e9, drive["ended_unix_time_ns"] / 1e9
        lasted_s = max(0, round(ended_s - began_s))
        table.add_row(
            "recording" if drive["open"] else "kept" if drive["kept"] else "",
            escape(one_line(drive["name"])),
            f"{datetime.fromtimestamp(began_s):%Y-%m-%d %H:%M}",
            f"{lasted_s // 60}:{lasted_s % 60:02d}",
            size_words(drive["size_bytes"]),
        )
    console = Console()
    console.print(table, width=None if console.is_terminal else 200)
    print(f"{found.free_bytes / 1e9:.1f} GB free on the robot's card")
