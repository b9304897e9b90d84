"""`workstation report` and `workstation film`: a recorded drive to look at."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mbot_workstation.cli.link_options import json_option
from mbot_workstation.cli.options import argument, option, with_options
from mbot_workstation.cli.output_paths import check_new_file


def _recording(words: str, metavar: str) -> Any:
    return argument(
        f"{words} that `recordings fetch` or `telemetry --record` made.", metavar=metavar
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportOptions:
    """What `report` takes."""

    recordings: list[Path] = _recording("Folders or files", "RECORDING...")
    output: Path = option(
        Path("drive.html"), "The page, a new file.", "--output", "-o", metavar="FILE.html"
    )
    maps: list[Path] | None = option(
        None,
        "Also draw the path that `virtual-robot --trajectory` wrote meanwhile. Repeatable.",
        "--map",
        metavar="FILE.jsonl",
    )
    models: list[Path] | None = option(
        None,
        "Policies among which those that drove are found by their digests, to show where they "
        "looked; *.onnx, models/*.onnx and runs/*/*.onnx here if not given. Repeatable.",
        "--model",
        metavar="MODEL.onnx",
    )
    as_json: bool = json_option()


@with_options
def report(options: ReportOptions) -> None:
    """Write what happened in recorded drives as one page; several for comparison.

    A sentence, pictures over the whole drive and what mattered in them to the policy, wheels,
    latencies, missed beats, faults, the model's digest. The page needs no other file and no
    network, prints, and reads on a phone.

    Example: `workstation report drives/mbot-1/drive-0012-20261122-171501`
    """
    import json
    import sys

    from mbot_protocol.beat.recorded_drive import read_drives
    from mbot_protocol.errors import ConfigurationError
    from mbot_protocol.files import atomic_file
    from mbot_workstation.look.drives.attention import attention
    from mbot_workstation.look.drives.drive_figures import figures
    from mbot_workstation.look.drives.drive_page import STRIP_TILES, drive_page
    from mbot_workstation.look.drives.driven_path import read_path
    from mbot_workstation.look.drives.replayed_drive import models_near

    check_new_file(options.output)
    drives = [figures(drive) for drive in read_drives(options.recordings)]
    places = [place for path in options.maps or [] for place in read_path(path)]
    models = options.models or models_near(Path())
    looked = [attention(one.chosen(STRIP_TILES), models) for one in drives]
    page = drive_page(drives, places, [looks for looks, _ in looked])
    try:
        atomic_file.replace(options.output, page.encode())
    except OSError as error:
        raise ConfigurationError(f"can't write {options.output}: {error.strerror}") from None
    if options.as_json:
        fields = [
            {
                "recording": one.drive.name,
                "sentence": one.sentence,
                "models": list(one.models),
                "decisions": len(one.drive.decided),
                "missed_beats": one.missed_beats,
                "lost_records": one.lost_records,
                "faults": [list(fault) for fault in one.faults],
            }
            for one in drives
        ]
        print(json.dumps({"path": str(options.output), "drives": fields}, indent=2))
        return
    for one, (_, words) in zip(drives, looked, strict=True):
        print(f"{one.drive.name}: {one.sentence}")
        for line in words:
            print(f"workstation: note: {line}", file=sys.stderr)
    print(f"wrote {options.output}")


@dataclass(frozen=True, slots=True, kw_only=True)
class FilmOptions:
    """What `film` takes."""

    recording: Path = _recording("A folder or file", "RECORDING")
    output: Path = argument(
        "The film, a new file, by its name MP4 or GIF.", metavar="FILE.mp4|FILE.gif"
    )


@with_options
def film(options: FilmOptions) -> None:
    """Make a film of a recorded drive: what the policy saw, with its wheels, in real time.

    Example: `workstation film drives/mbot-1/drive-0012-20261122-171501 drive.mp4`
    """
    from mbot_protocol.beat.recorded_drive import read_drive
    from mbot_workstation.look.drives.drive_film import film as make_film

    check_new_file(options.output)
    lasts_s = make_film(read_drive(options.recording), options.output)
    print(f"wrote {options.output}, {lasts_s:.1f} s")
