"""`workstation training-curve`: how training runs went, as a picture."""

from dataclasses import dataclass
from pathlib import Path

from mbot_workstation.cli.options import argument, output_file, with_options
from mbot_workstation.cli.output_paths import PICTURES


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainingCurveOptions:
    """What `training_curve` takes."""

    runs: list[Path] = argument("Folders of runs, all drawn into one picture.", metavar="RUN...")
    output: Path | None = output_file(
        None,
        "curve.png in the first run's folder if not given.",
        "--output",
        "-o",
        endings=PICTURES,
        metavar="FILE.png",
    )


@with_options
def training_curve(options: TrainingCurveOptions) -> None:
    """Draw reward, episode length and lesson over the decisions of runs, as the paper's Fig. 4.

    Examples:

    - `workstation training-curve runs/first -o curve.png`
    - `workstation training-curve runs/seed-1 runs/seed-2 runs/seed-3 -o seeds.png`
    """
    from mbot_protocol.errors import ConfigurationError
    from mbot_workstation.learn.learning.learning_curve import draw_curves
    from mbot_workstation.learn.learning.progress_display import clock
    from mbot_workstation.learn.learning.progress_log import (
        ROW_EVERY,
        ProgressRow,
        read_progress,
    )
    from mbot_workstation.learn.learning.run_directory import RunDirectory
    from mbot_workstation.learn.learning.training_config import read_config
    from mbot_workstation.tasks.find import find_task

    runs = {str(path): RunDirectory.open(path) for path in options.runs}
    if len(runs) == 1:
        runs = {run.path.resolve().name: run for run in runs.values()}
    drawn: dict[str, list[ProgressRow]] = {}
    said: list[str] = []
    for name, run in runs.items():
        steps = read_config(run.config_file).steps
        rows = read_progress(run.progress_file) if run.progress_file.is_file() else []
        if not rows:
            raise ConfigurationError(
                f"{run.path} has no row in progress.csv yet: one comes every {ROW_EVERY:,} of its "
                f"{steps:,} decisions"
            )
        step, wall_s = rows[-1].step, rows[-1].wall_s
        more = f"all {step:,} decisions made"
        if step < steps and wall_s > 0:
            left = clock((steps - step) * wall_s / step)
            more = f"{step:,} of {steps:,} decisions made, {left} of training to go"
        said.append(f"{name}: {more}" if len(runs) > 1 else more)
        drawn[name] = rows
    first = read_config(next(iter(runs.values())).config_file)
    path = options.output or next(iter(runs.values())).curve_file
    draw_curves(drawn, find_task(first.task), path)
    print(f"wrote {path}: {'; '.join(said)}")
