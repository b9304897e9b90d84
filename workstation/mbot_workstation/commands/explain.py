"""`workstation explain`: what a policy sees in a picture."""

from dataclasses import dataclass
from pathlib import Path

from mbot_workstation.commands.link_options import json_option
from mbot_workstation.commands.options import argument, option, output_file, with_options
from mbot_workstation.commands.output_paths import PICTURES


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplainOptions:
    """What `explain` takes."""

    model: Path = argument("A learned policy.", metavar="MODEL.onnx")
    more_frames: list[Path] | None = argument("More pictures.", default=None, metavar="[FILE]...")
    frames: list[Path] | None = option(
        None,
        "Pictures to explain: 64 x 64 as the policy sees it, or the whole camera's.",
        "--frames",
        metavar="FILE",
    )
    recording: Path | None = option(None, "Take pictures from this recording.", metavar="FILE.mcap")
    count: int = option(4, "How many, evenly spread over the recording.", min=1, max=12)
    output: Path = output_file(
        Path("explanation.png"),
        "The picture to write.",
        "--output",
        "-o",
        endings=PICTURES,
        metavar="FILE.png",
    )
    as_json: bool = json_option()


@with_options
def explain(options: ExplainOptions) -> None:
    """Show what the first layer of a policy makes of pictures, and what the policy then does.

    Without --frames and --recording: three pictures as in the paper, with no object, with the
    object on the left, and with the object straight ahead.

    Examples:

    - `workstation explain policy.onnx -o explanation.png`
    - `workstation explain policy.onnx --frames a.png b.png`
    - `workstation explain policy.onnx --recording drive.mcap --count 6`
    """
    import json

    from mbot_protocol.errors import ConfigurationError
    from mbot_workstation.models.check import check_model
    from mbot_workstation.training.evaluation.activations import Microscope
    from mbot_workstation.training.evaluation.explanation import draw, load_frame, recorded_frames

    files = [*(options.frames or ()), *(options.more_frames or ())]
    if files and options.recording:
        raise ConfigurationError("--frames and --recording: give one of the two")
    checked = check_model(options.model)
    microscope = Microscope(checked.data)
    view = checked.metadata.view
    if options.recording is not None:
        pictures = recorded_frames(options.recording, options.count, view)
    elif files:
        pictures = {path.stem: load_frame(path, view) for path in files}
    else:
        from mbot_workstation.training.worlds.example_frames import example_frames

        pictures = example_frames()
    seen = {title: microscope.look(picture) for title, picture in pictures.items()}
    draw(seen, options.output)
    if options.as_json:
        actions = {title: [round(v, 4) for v in one.action] for title, one in seen.items()}
        print(json.dumps({"path": str(options.output), "actions": actions}))
    else:
        for title, one in seen.items():
            left, right = one.action
            print(f"{title}: left {left:+.2f}, right {right:+.2f}")
        print(f"wrote {options.output}")
