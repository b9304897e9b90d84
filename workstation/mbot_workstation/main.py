"""The command `workstation`: one subcommand a module of `commands`."""

import sys

import typer

from mbot_protocol.errors import MbotError
from mbot_workstation.commands.calibrate import app as calibrate
from mbot_workstation.commands.demo import demo
from mbot_workstation.commands.drive import drive, run, stop
from mbot_workstation.commands.enroll import enroll
from mbot_workstation.commands.evaluate import evaluate
from mbot_workstation.commands.explain import explain
from mbot_workstation.commands.export import export
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
from mbot_workstation.commands.robots import robots
from mbot_workstation.commands.study import study
from mbot_workstation.commands.telemetry import telemetry
from mbot_workstation.commands.track_robot import track
from mbot_workstation.commands.train import train
from mbot_workstation.commands.training_curve import training_curve
from mbot_workstation.commands.virtual_robot import virtual_robot

app = typer.Typer(
    name="workstation",
    help="Simulation, model push and live telemetry for mbot-agent robots.",
    no_args_is_help=True,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
)

app.command("demo")(demo)
app.command("robots")(robots)
app.command("telemetry")(telemetry)
app.command("push-model")(push_model)
app.add_typer(keys, name="keys")
app.command("models")(models)
app.command("rollback")(rollback)
app.command("run")(run)
app.command("stop")(stop)
# Otherwise `drive -0.4 0.4` would look for an option -0.
app.command("drive", context_settings={"ignore_unknown_options": True})(drive)
app.command("make-servo-policy")(make_servo_policy)
app.command("virtual-robot")(virtual_robot)
app.command("flash")(flash)
app.command("enroll")(enroll)
app.add_typer(print_targets, name="print")
app.add_typer(calibrate, name="calibrate")
app.command("panorama")(panorama)
app.command("gap-report")(gap_report)
app.add_typer(maneuvers, name="maneuvers")
app.command("track")(track)
app.command("identify")(identify)
app.command("train")(train)
app.command("export")(export)
app.command("evaluate")(evaluate)
app.command("explain")(explain)
app.command("training-curve")(training_curve)
app.command("study")(study)


TRAINING_LIBRARIES = {"gymnasium", "joblib", "stable_baselines3", "torch"}


def main() -> None:
    """Run the command line; an error meant for a person is one line and an exit code."""
    try:
        app()
    except MbotError as error:
        print(f"workstation: {error}", file=sys.stderr)
        sys.exit(error.exit_code)
    except ModuleNotFoundError as error:
        if error.name not in TRAINING_LIBRARIES:
            raise
        print(
            f"workstation: this command needs {error.name}: pip install -e '.[train]' in the "
            "checkout",
            file=sys.stderr,
        )
        sys.exit(1)
