"""`workstation recordings`: the drives that a robot has recorded."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.common_options import LinkOptions, json_option
from mbot_workstation.cli.options import argument, option, output_file, with_options
from mbot_workstation.cli.presenter import Answer, table
from mbot_workstation.wording import one_line, size_words, typed

if TYPE_CHECKING:
    from mbot_protocol.beat.recorded_drive import RecordedDrive
    from mbot_protocol.v1.recordings_pb2 import RecordingList
    from mbot_workstation.look.drives.gap_filling import Gap

app = typer.Typer(help="The drives that a robot has recorded.", no_args_is_help=True)

_WHICH = "Its number, its name or the beginning of it, or 'last'"


def _drives_argument(default: Any = None) -> Any:
    given = {} if default is None else {"default": default}
    return argument(f"Which drives. {_WHICH}.", metavar="DRIVE...", **given)


@dataclass(frozen=True, slots=True, kw_only=True)
class ListDrivesOptions(LinkOptions):
    """What `recordings list` takes."""

    as_json: bool = json_option()


@app.command("list")
@with_options
def list_command(options: ListDrivesOptions) -> Answer:
    """List the drives that a robot has recorded, newest first.

    Example: `workstation recordings list --robot mbot-1.local`
    """
    from mbot_workstation.fleet.link.recording_fetch import list_recordings

    with options.link() as link:
        return _listed(list_recordings(link))


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
def fetch_command(options: FetchOptions) -> Answer:
    """Bring recorded drives here; an interrupted fetch goes on where it was.

    The robot may be driving meanwhile. What comes is compared with what the robot has by its
    SHA-256.

    Example: `workstation recordings fetch 12 --robot mbot-1.local`
    """
    from mbot_workstation.fleet.link.recording_fetch import choose, fetch, list_recordings

    with options.link() as link:
        there = list(list_recordings(link).drives)
        wanted = there if options.everything else [choose(there, one) for one in options.drives]
        folders = [fetch(link, drive, options.into, _progress(drive.name)) for drive in wanted]
    sizes = [size_words(sum(file.size_bytes for file in drive.files)) for drive in wanted]
    said = [f"{one}  {size}" for one, size in zip(folders, sizes, strict=True)]
    if folders:
        said.append(f"next: workstation report {typed(folders[-1])}")
    return Answer(folders, said)


@dataclass(frozen=True, slots=True, kw_only=True)
class KeepOptions(LinkOptions):
    """What `recordings keep` takes."""

    drives: list[str] = _drives_argument()
    kept: bool = option(True, "Set or clear the mark.", "--yes/--no")
    as_json: bool = json_option()


@app.command("keep")
@with_options
def keep_command(options: KeepOptions) -> Answer:
    """Mark drives so that the robot keeps them, whatever their age and however little room.

    Example: `workstation recordings keep last --robot mbot-1.local`
    """
    from mbot_workstation.fleet.link.recording_fetch import choose, keep, list_recordings

    with options.link() as link:
        found = list_recordings(link)
        for name in [choose(list(found.drives), one).name for one in options.drives]:
            found = keep(link, name, kept=options.kept)
    return _listed(found)


@dataclass(frozen=True, slots=True, kw_only=True)
class RemoveOptions(LinkOptions):
    """What `recordings remove` takes."""

    drives: list[str] = _drives_argument()
    as_json: bool = json_option()


@app.command("remove")
@with_options
def remove_command(options: RemoveOptions) -> Answer:
    """Remove drives from the robot for good.

    Example: `workstation recordings remove 12 --robot mbot-1.local`
    """
    from mbot_workstation.fleet.link.recording_fetch import choose, list_recordings, remove

    with options.link() as link:
        found = list_recordings(link)
        for name in [choose(list(found.drives), one).name for one in options.drives]:
            found = remove(link, name)
    return _listed(found)


def _progress(name: str) -> Callable[[int, int], None]:
    """Bytes on stderr, where a person looks at it."""
    import sys

    def tell(here: int, whole: int) -> None:
        if sys.stderr.isatty():
            end = "\n" if here == whole else ""
            print(f"\r{name}: {here / 1e6:.1f} of {whole / 1e6:.1f} MB", end=end, file=sys.stderr)

    return tell


@dataclass(frozen=True, slots=True)
class DriveThere:
    """A drive that a robot has recorded."""

    name: str
    started_unix_time_ns: int
    ended_unix_time_ns: int
    size_bytes: int
    files: list[str]
    kept: bool
    open: bool

    def cells(self) -> tuple[str, ...]:
        """For a table: mark, name, beginning, how long it lasted, size."""
        from datetime import datetime

        began = datetime.fromtimestamp(self.started_unix_time_ns / 1e9)
        lasted_s = max(0, round((self.ended_unix_time_ns - self.started_unix_time_ns) / 1e9))
        return (
            "recording" if self.open else "kept" if self.kept else "",
            one_line(self.name),
            f"{began:%Y-%m-%d %H:%M}",
            f"{lasted_s // 60}:{lasted_s % 60:02d}",
            size_words(self.size_bytes),
        )


def _listed(found: "RecordingList") -> Answer:
    drives = [
        DriveThere(
            one.name,
            one.started_unix_time_ns,
            one.ended_unix_time_ns,
            sum(file.size_bytes for file in one.files),
            [file.name for file in one.files],
            one.kept,
            one.open,
        )
        for one in found.drives
    ]
    if not drives:
        why = "" if found.enabled else " and records none: [recording] enabled in its configuration"
        return Answer(drives, [f"the robot keeps no recordings{why}"])
    shown = table(("", "drive", "began", "lasted", "size"), (drive.cells() for drive in drives))
    return Answer(drives, [shown, f"{found.free_bytes / 1e9:.1f} GB free on the robot's card"])


@dataclass(frozen=True, slots=True, kw_only=True)
class FillOptions(LinkOptions):
    """What `recordings fill` takes."""

    recording: Path = argument("What `telemetry --record` has written.", metavar="FILE.mcap")
    output: Path | None = output_file(
        None,
        "The filled recording, a new file; FILE-filled.mcap beside FILE if not given.",
        "--output",
        "-o",
        metavar="FILE.mcap",
    )
    drives: list[Path] | None = option(
        None,
        "Recordings of the robot that are here already; repeatable. If not given, the robot is "
        "asked for those that may have what is missing.",
        "--from",
        metavar="RECORDING",
    )
    into: Path = option(
        Path("drives"), "Folder for what is fetched, as of `fetch`.", "--into", metavar="FOLDER"
    )
    as_json: bool = json_option()


@dataclass(frozen=True, slots=True)
class FilledRecording:
    """How much of what a link has lost could be filled; no output if nothing was missing."""

    output: Path | None
    beats: int
    filled_beats: int
    filled_pictures: int
    still_missing: int


@app.command("fill")
@with_options
def fill_command(options: FillOptions) -> Answer:
    """Fill what a slow or broken link has lost from a recording, from the robot's own.

    Both number the beats alike, so exactly what is missing is taken, and nothing is guessed. The
    robot's own begins when it is armed: what was lost while it stood stays lost. The file itself
    stays as it is.

    Example: `workstation recordings fill drive.mcap --robot mbot-1.local`
    """
    from mbot_protocol.beat.recorded_drive import read_drive
    from mbot_workstation.look.drives.gap_filling import fill, gaps, write

    live = read_drive(options.recording)
    lacking = gaps(live.beats)
    missing, blind = sum(gap.count for gap in lacking), sum(not b.encoded for b in live.beats)
    found, output = fill(live.beats, ()), None
    if missing or blind:
        drives = options.drives or _fetched(options, live, lacking)
        found = fill(live.beats, map(read_drive, drives))
        beside = options.recording.with_name(f"{options.recording.stem}-filled.mcap")
        output = options.output or beside
        write(output, found)
    filled = FilledRecording(
        output, len(found.beats), found.decisions, found.pictures, found.still_missing
    )
    if output is None:
        words = f"{options.recording}: nothing is missing, so nothing was written"
    else:
        words = (
            f"{output}: {found.decisions} of {missing} missing beats filled, "
            f"{found.pictures} pictures added, {found.still_missing} beats still missing"
        )
    return Answer(filled, [words])


def _fetched(options: FillOptions, live: "RecordedDrive", lacking: "list[Gap]") -> list[Path]:
    """The robot's recordings that may have what is missing, brought here.

    Where pictures alone are missing the times of the whole recording count.
    """
    from mbot_workstation.fleet.link.recording_fetch import fetch, list_recordings
    from mbot_workstation.look.drives.gap_filling import Gap

    first, last = live.beats[0].decision, live.beats[-1].decision
    whole = Gap(0, 0, 0, first.unix_time_ns, last.unix_time_ns)
    with options.link() as link:
        if link.robot_id != live.robot_id:
            raise ConfigurationError(
                f"{options.recording} is of robot {one_line(live.robot_id)}, and this one is "
                f"{link.robot_id}: name the other by --robot"
            )
        return [
            fetch(link, drive, options.into)
            for drive in reversed(list_recordings(link).drives)
            if any(
                gap.may_be_in(drive.started_unix_time_ns, drive.ended_unix_time_ns)
                for gap in lacking or [whole]
            )
        ]
