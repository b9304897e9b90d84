"""`workstation explain`: what a policy sees in a picture."""

from pathlib import Path
from typing import Annotated

import typer

from mbot_workstation.commands.link_options import JsonOption


def explain(
    *,
    model: Annotated[Path, typer.Argument(metavar="MODEL.onnx", help="A learned policy.")],
    more_frames: Annotated[
        list[Path] | None, typer.Argument(metavar="[FILE]...", help="More pictures.")
    ] = None,
    frames: Annotated[
        list[Path] | None,
        typer.Option(
            "--frames",
            metavar="FILE",
            help="Pictures to explain: 64 x 64 as the policy sees it, or the whole camera's.",
        ),
    ] = None,
    recording: Annotated[
        Path | None,
        typer.Option(metavar="FILE.mcap", help="Take pictures from this recording."),
    ] = None,
    count: Annotated[
        int, typer.Option(min=1, max=12, help="How many, evenly spread over the recording.")
    ] = 4,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE.png", help="The picture to write.")
    ] = Path("explanation.png"),
    as_json: JsonOption = False,
) -> None:
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

    files = [*(frames or ()), *(more_frames or ())]
    if files and recording:
        raise ConfigurationError("--frames and --recording: give one of the two")
    checked = check_model(model)
    microscope = Microscope(checked.data)
    view = checked.metadata.view
    if recording is not None:
        pictures = recorded_frames(recording, count, view)
    elif files:
        pictures = {path.stem: load_frame(path, view) for path in files}
    else:
        from mbot_workstation.training.worlds.example_frames import example_frames

        pictures = example_frames()
    seen = {title: microscope.look(picture) for title, picture in pictures.items()}
    draw(seen, output)
    if as_json:
        actions = {title: [round(v, 4) for v in one.action] for title, one in seen.items()}
        print(json.dumps({"path": str(output), "actions": actions}))
    else:
        for title, one in seen.items():
            left, right = one.action
            print(f"{title}: left {left:+.2f}, right {right:+.2f}")
        print(f"wrote {output}")
