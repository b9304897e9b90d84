"""`workstation training-curve`: how a training run went, as a picture."""

from pathlib import Path
from typing import Annotated

import typer


def training_curve(
    *,
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A run's folder.")],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE.png", help="RUN/curve.png if not given."),
    ] = None,
) -> None:
    """Draw reward, episode length and lesson over the decisions of a run, as the paper's Fig. 4.

    Example: `workstation training-curve runs/first -o curve.png`
    """
    from mbot_workstation.training.learning.learning_curve import draw_curve
    from mbot_workstation.training.learning.progress_log import read_progress
    from mbot_workstation.training.learning.run_directory import RunDirectory

    found = RunDirectory.open(run)
    path = output or found.curve_file
    draw_curve(read_progress(found.progress_file), path, found.path.resolve().name)
    print(f"wrote {path}")
