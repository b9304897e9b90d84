"""`workstation recordings fill`: what a link has lost, from the robot's own recording."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mbot_workstation.cli.link_options import LinkOptions, json_option
from mbot_workstation.cli.options import argument, option, output_file, with_options

if TYPE_CHECKING:
    from mbot_protocol.beat.recorded_drive import RecordedDrive
    from mbot_workstation.look.drives.gap_filling import Gap


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


@with_options
def fill_command(options: FillOptions) -> None:
    """Fill what a slow or broken link has lost from a recording, from the robot's own.

    Both number the beats alike, so exactly what is missing is taken, and nothing is guessed. The
    robot's own begins when it is armed: what was lost while it stood stays lost. The file itself
    stays as it is.

    Example: `workstation recordings fill drive.mcap --robot mbot-1.local`
    """
    import json

    from mbot_protocol.beat.recorded_drive import read_drive
    from mbot_workstation.look.drives.gap_filling import fill, gaps, write

    live = read_drive(options.recording)
    lacking = gaps(live.beats)
    missing, blind = sum(gap.count for gap in lacking), sum(not b.encoded for b in live.beats)
    found = fill(live.beats, ())
    given = options.output
    output = given or options.recording.with_name(f"{options.recording.stem}-filled.mcap")
    if missing or blind:
        drives = options.drives or _fetched(options, live, lacking)
        found = fill(live.beats, map(read_drive, drives))
        write(output, found)
    if options.as_json:
        fields = {
            "output": str(output) if missing or blind else None,
            "beats": len(found.beats),
            "filled_beats": found.decisions,
            "filled_pictures": found.pictures,
            "still_missing": found.still_missing,
        }
        print(json.dumps(fields))
    elif not missing and not blind:
        print(f"{options.recording}: nothing is missing, so nothing was written")
    else:
        print(
            f"{output}: {found.decisions} of {missing} missing beats filled, "
            f"{found.pictures} pictures added, {found.still_missing} beats still missing"
        )


def _fetched(options: FillOptions, live: "RecordedDrive", lacking: "list[Gap]") -> list[Path]:
    """The robot's recordings that may have what is missing, brought here.

    Where pictures alone are missing the times of the whole recording count.
    """
    from mbot_protocol.errors import ConfigurationError
    from mbot_workstation.fleet.link.recording_fetch import fetch, list_recordings
    from mbot_workstation.look.drives.gap_filling import Gap
    from mbot_workstation.wording import one_line

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
