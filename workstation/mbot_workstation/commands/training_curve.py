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
    from mbot_protocol.errors import ConfigurationError
    from mbot_workstation.training.learning.learning_curve import draw_curve
    from mbot_workstation.training.learning.progress_display import clock
    from mbot_workstation.training.learning.progress_log import ROW_EVERY, read_progress
    from mbot_workstation.training.learning.run_directory import RunDirectory
    from mbot_workstation.training.learning.training_config import read_config

    found = RunDirectory.open(options.run)
    path = options.output or found.curve_file
    steps = read_config(found.config_file).steps
    rows = read_progress(found.progress_file) if found.progress_file.is_file() else []
    if not rows:
        raise ConfigurationError(
            f"{options.run} has no row in progress.csv yet: one comes every {ROW_EVERY:,} of its "
            f"{steps:,} decisions"
        )
    draw_curve(rows, path, found.path.resolve().name)
    step, wall_s = rows[-1].step, rows[-1].wall_s
    more = f"all {step:,} decisions made"
    if step < steps and wall_s > 0:
        left = clock((steps - step) * wall_s / step)
        more = f"{step:,} of {steps:,} decisions made, {left} of training to go"
    print(f"wrote {path}: {more}")
