"""All subcommands of `workstation`, in the groups in which `--help` shows them."""

from collections.abc import Callable
from typing import Any

import typer
from typer.core import TyperGroup

from mbot_workstation.cli.calibrate import app as calibrate
from mbot_workstation.cli.calibrate import panorama
from mbot_workstation.cli.collect import app as collected
from mbot_workstation.cli.demo import demo, make_servo_policy
from mbot_workstation.cli.drives import film, replay, report, view
from mbot_workstation.cli.driving import console, drive, mark, robots, run, stop, telemetry
from mbot_workstation.cli.enroll import enroll
from mbot_workstation.cli.evaluate import evaluate, explain, study
from mbot_workstation.cli.identify import gap_report, identify
from mbot_workstation.cli.keys import app as keys
from mbot_workstation.cli.maneuvers import app as maneuvers
from mbot_workstation.cli.models import check_model_file, models, push_model, rollback, use
from mbot_workstation.cli.objects import look_at_object
from mbot_workstation.cli.policies import app as policies
from mbot_workstation.cli.policies import publish
from mbot_workstation.cli.print_targets import app as print_targets
from mbot_workstation.cli.promote import promote
from mbot_workstation.cli.recordings import app as recordings
from mbot_workstation.cli.robot import app as robot
from mbot_workstation.cli.set_up import flash, setup_card, update
from mbot_workstation.cli.support import faults, support
from mbot_workstation.cli.tasks import app as tasks
from mbot_workstation.cli.track import track
from mbot_workstation.cli.train import export, train, training_curve
from mbot_workstation.cli.virtual_robot import virtual_robot

PANELS: dict[str, dict[str, Callable[..., None] | typer.Typer]] = {
    "Try it without hardware": {
        "demo": demo,
        "virtual-robot": virtual_robot,
        "make-servo-policy": make_servo_policy,
    },
    "Set a robot up": {
        "robot": robot,
        "flash": flash,
        "keys": keys,
        "enroll": enroll,
        "setup-card": setup_card,
        "update": update,
    },
    "Give it models": {
        "check-model": check_model_file,
        "push-model": push_model,
        "models": models,
        "use": use,
        "rollback": rollback,
    },
    "Drive it": {
        "robots": robots,
        "support": support,
        "run": run,
        "stop": stop,
        "console": console,
        "telemetry": telemetry,
        "drive": drive,
        "mark": mark,
    },
    "Look at drives": {
        "recordings": recordings,
        "drives": collected,
        "view": view,
        "report": report,
        "film": film,
        "faults": faults,
        "replay": replay,
    },
    "Measure it": {
        "print": print_targets,
        "calibrate": calibrate,
        "panorama": panorama,
        "maneuvers": maneuvers,
        "track": track,
        "identify": identify,
        "gap-report": gap_report,
    },
    "Train and evaluate policies": {
        "object": look_at_object,
        "task": tasks,
        "train": train,
        "training-curve": training_curve,
        "evaluate": evaluate,
        "export": export,
        "explain": explain,
        "study": study,
        "promote": promote,
        "publish": publish,
        "policies": policies,
    },
}
"""In the order in which a user meets them."""

_ORDER = [name for panel in PANELS.values() for name in panel]


class InOrder(TyperGroup):
    """Typer would list those that have subcommands of their own last."""

    def list_commands(self, ctx: Any) -> list[str]:
        """All names, as `--help` shows them."""
        return sorted(super().list_commands(ctx), key=_ORDER.index)


app = typer.Typer(
    name="workstation",
    cls=InOrder,
    help="Simulate, train for, measure, command and watch mbot-agent robots.",
    no_args_is_help=True,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
)


def _version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        print(f"workstation {version('mbot-agent')}")
        raise typer.Exit


@app.callback()
def workstation(
    _: bool = typer.Option(
        False, "--version", help="Print the version and exit.", callback=_version, is_eager=True
    ),
) -> None:
    """Simulate, train for, measure, command and watch mbot-agent robots."""


for panel, commands in PANELS.items():
    for name, command in commands.items():
        if isinstance(command, typer.Typer):
            app.add_typer(command, name=name, rich_help_panel=panel)
        else:
            # Otherwise `drive -0.4 0.4` would look for an option -0.
            settings = {"ignore_unknown_options": True} if command is drive else None
            app.command(name, rich_help_panel=panel, context_settings=settings)(command)
