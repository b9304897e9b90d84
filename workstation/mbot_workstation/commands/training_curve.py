"""`workstation training-curve`: how a training run went, as a picture."""

from dataclasses import dataclass
from pathlib import Path

from mbot_workstation.commands.options import argument, output_file, with_options
from mbot_workstation.commands.output_paths import PICTURES


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainingCurveOptions:
    """What `training_curve` takes."""

    run: Path = argument("A run's folder.", metavar="RUN")
    output: Path | None = output_file(
        None, "RUN/curve.png if not given.", "--output", "-o", endings=PICTURES, metavar="FILE.png"
    )


@with_options
def training_curve(options: TrainingCurveOptions) -> None:
    """Draw reward, episode length and lesson over the decisions of a run, as the paper's Fig. 4.

    Example: `workstation training-curve runs/first -o curve.png`
    """
    from mbot_workstation.training.learning.learning_curve import draw_curve
    from mbot_workstation.training.learning.progress_log import read_progress
    from mbot_workstation.training.learning.run_directory import RunDirectory

    found = RunDirectory.open(options.run)
    path = options.output or found.curve_file
    draw_curve(read_progress(found.progress_file), path, found.path.resolve().name)
    print(f"wrote {path}")
