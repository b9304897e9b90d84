"""`workstation replay`: a recorded drive decided once more."""

from dataclasses import dataclass
from pathlib import Path

from mbot_workstation.cli.link_options import json_option
from mbot_workstation.cli.options import argument, option, with_options

DIFFERS = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayOptions:
    """What `replay` takes."""

    recording: Path = argument(
        "A folder that `recordings fetch` made, or one of its files.", metavar="RECORDING"
    )
    model: Path | None = option(
        None,
        "By which model; if not given, the one that drove, found by its digest among *.onnx, "
        "models/*.onnx and runs/*/*.onnx here.",
        "--model",
        metavar="MODEL.onnx",
    )
    strip: Path | None = option(
        None, "Also draw the decisions that differ most.", "--strip", metavar="FILE.png"
    )
    as_json: bool = json_option()


@with_options
def replay(options: ReplayOptions) -> None:
    """Decide a recorded drive once more, by the daemon's own code, and compare.

    The model that drove must decide the same again: to the last bit on the same kind of processor,
    to 1e-5 on another; if it does not, the exit code is 1. With --model OTHER: where would it have
    done otherwise?

    Examples:
    `workstation replay drives/mbot-1/drive-0012-20261122-171501`,
    `workstation replay RECORDING --model other.onnx --strip other.png`

    """
    import json
    import sys

    import typer

    from mbot_protocol.beat.recorded_drive import read_drive
    from mbot_workstation.look.drives import replay_words
    from mbot_workstation.look.drives.replayed_drive import models_near
    from mbot_workstation.look.drives.replayed_drive import replay as decide_again
    from mbot_workstation.pictures.picture_file import write_picture

    drive = read_drive(options.recording)
    found = decide_again(drive, models_near(Path()), options.model)
    if options.as_json:
        print(json.dumps(replay_words.fields(found), indent=2))
    else:
        for words in drive.words:
            print(f"workstation: {words}", file=sys.stderr)
        for line in replay_words.lines(found):
            print(line)
    if options.strip is not None:
        write_picture(options.strip, replay_words.strip(found))
        print(f"drawn into {options.strip}", file=sys.stderr)
    if not found.is_as_expected:
        raise typer.Exit(DIFFERS)
