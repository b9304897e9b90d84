"""`workstation explain`: what a policy sees in a picture."""

from dataclasses import dataclass
from pathlib import Path

from mbot_workstation.cli.link_options import json_option
from mbot_workstation.cli.options import argument, option, output_file, with_options
from mbot_workstation.cli.output_paths import PICTURES


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplainOptions:
    """What `explain` takes."""

    model: Path = argument("A policy.", metavar="MODEL.onnx")
    more_frames: list[Path] | None = argument("More pictures.", default=None, metavar="[FILE]...")
    frames: list[Path] | None = option(
        None,
        "Pictures to explain: 64 x 64 as the policy sees it, or the whole camera's.",
        "--frames",
        metavar="FILE",
    )
    recording: Path | None = option(None, "Take pictures from this recording.", metavar="REC")
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
    """Show where a policy looks in pictures, what its first layer makes of them, and what it does.

    Each place of a picture is blurred away in turn; what changes the wheels matters to the policy.
    In a recording a policy with a memory has in mind what came before, from where the robot began
    anew last (after a stop, a hold, a gap), and the picture shows what it would do without.

    Without --frames and --recording: three pictures as in the paper, with no object, with the
    object on the left, and with the object straight ahead.

    Examples:

    - `workstation explain policy.onnx -o explanation.png`
    - `workstation explain policy.onnx --frames a.png b.png`
    - `workstation explain policy.onnx --recording drive.mcap --count 6`
    """
    import json

    import numpy as np

    from mbot_protocol.errors import ConfigurationError
    from mbot_workstation.fleet.models.check import check_model
    from mbot_workstation.learn.evaluation.activations import ActivationReader
    from mbot_workstation.learn.evaluation.explanation import draw, load_frame, recorded_glances

    files = [*(options.frames or ()), *(options.more_frames or ())]
    if files and options.recording:
        raise ConfigurationError("--frames and --recording: give one of the two")
    checked = check_model(options.model)
    reader = ActivationReader(checked.data)
    view = checked.metadata.view
    if options.recording is not None:
        seconds, drive = recorded_glances(options.recording, view)
        spread = np.linspace(0, len(drive) - 1, options.count).round().astype(int)
        chosen = sorted(set(spread.tolist()))
        looks = reader.look_back(drive, chosen)
        seen = {f"{seconds[i]:.1f} s": one for i, one in zip(chosen, looks, strict=True)}
    else:
        if files:
            pictures = {path.stem: load_frame(path, view) for path in files}
        else:
            from mbot_workstation.learn.worlds.example_frames import example_frames

            pictures = example_frames()
        seen = {title: reader.look(picture) for title, picture in pictures.items()}
    draw(seen, options.output)
    if options.as_json:
        actions = {title: [round(v, 4) for v in one.action] for title, one in seen.items()}
        without = {t: one.first_action for t, one in seen.items() if one.first_action is not None}
        told = {"path": str(options.output), "actions": actions, "actions_without_memory": without}
        print(json.dumps(told))
    else:
        for title, one in seen.items():
            first = one.first_action
            without = f"; without memory {first[0]:+.2f}, {first[1]:+.2f}" if first else ""
            print(f"{title}: left {one.action[0]:+.2f}, right {one.action[1]:+.2f}{without}")
        print(f"wrote {options.output}")
