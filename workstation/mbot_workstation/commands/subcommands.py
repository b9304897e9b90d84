"""All subcommands of `workstation`, in the groups in which `--help` shows them."""

from collections.abc import Callable
from typing import Any

import typer
from typer.core import TyperGroup

from mbot_workstation.commands.calibrate import app as calibrate
from mbot_workstation.commands.check_model import check_model_file
from mbot_workstation.commands.console import console
from mbot_workstation.commands.demo import demo
from mbot_workstation.commands.drive import drive, run, stop
from mbot_workstation.commands.drive_report import film, report
from mbot_workstation.commands.enroll import enroll
from mbot_workstation.commands.evaluate import evaluate
from mbot_workstation.commands.explain import explain
from mbot_workstation.commands.export import export
from mbot_workstation.commands.fill_recording import fill_command
from mbot_workstation.commands.flash import flash
from mbot_workstation.commands.gap_report import gap_report
from mbot_workstation.commands.identify import identify
from mbot_workstation.commands.make_servo_policy import make_servo_policy
from mbot_workstation.commands.maneuvers import app as maneuvers
from mbot_workstation.commands.model_keys import app as keys
from mbot_workstation.commands.models import models, rollback
from mbot_workstation.commands.panorama import panorama
from mbot_workstation.commands.print_targets import app as print_targets
from mbot_workstation.commands.push_model import push_model
from mbot_workstation.commands.recordings import app as recordings
from mbot_workstation.commands.replay import replay
from mbot_workstation.commands.robots import robots
from mbot_workstation.commands.setup_card import setup_card
from mbot_workstation.commands.study import study
from mbot_workstation.commands.telemetry import telemetry
from mbot_workstation.commands.track_robot import track
from mbot_workstation.commands.train import train
from mbot_workstation.commands.training_curve import training_curve
from mbot_workstation.commands.update import update
from mbot_workstation.commands.view_drives import view
from mbot_workstation.commands.virtual_robot import virtual_robot

PANELS: dict[str, dict[str, Callable[..., None] | typer.Typer]] = {
    "Try it without hardware": {
        "demo": demo,
        "virtual-robot": virtual_robot,
        "make-servo-policy": make_servo_policy,
    },
    "Set a robot up": {
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
        "rollback": rollback,
    },
    "Drive it": {
        "robots": robots,
        "run": run,
        "stop": stop,
        "console": console,
        "telemetry": telemetry,
        "drive": drive,
    },
    "Look at drives": {
        "recordings": recordings,
        "view": view,
        "report": report,
        "film": film,
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
        "train": train,
        "training-curve": training_curve,
        "evaluate": evaluate,
        "export": export,
        "explain": explain,
        "study": study,
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


recordings.command("fill")(fill_command)
for panel, commands in PANELS.items():
    for name, command in commands.items():
        if isinstance(command, typer.Typer):
            app.add_typer(command, name=name, rich_help_panel=panel)
        else:
            # Otherwise `drive -0.4 0.4` would look for an option -0.
            settings = {"ignore_unknown_options": True} if command is drive else None
            app.command(name, rich_help_panel=panel, context_settings=settings)(command)
