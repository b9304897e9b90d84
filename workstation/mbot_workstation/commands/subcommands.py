"""All subcommands of `workstation`, in the groups in which `--help` shows them."""

import typer

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

app = typer.Typer(
    name="workstation",
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


_TRY, _DRIVE, _MODELS = "Try it without hardware", "Drive a robot", "Models and who may send them"
_LOOK = "Look at drives"
_TRAIN, _MEASURE = "Train and evaluate policies", "Measure a robot"

app.command("demo", rich_help_panel=_TRY)(demo)
app.command("virtual-robot", rich_help_panel=_TRY)(virtual_robot)
app.command("make-servo-policy", rich_help_panel=_TRY)(make_servo_policy)

app.command("robots", rich_help_panel=_DRIVE)(robots)
app.command("console", rich_help_panel=_DRIVE)(console)
app.command("telemetry", rich_help_panel=_DRIVE)(telemetry)
app.command("run", rich_help_panel=_DRIVE)(run)
app.command("stop", rich_help_panel=_DRIVE)(stop)
# Otherwise `drive -0.4 0.4` would look for an option -0.
negative_numbers = {"ignore_unknown_options": True}
app.command("drive", rich_help_panel=_DRIVE, context_settings=negative_numbers)(drive)
app.command("flash", rich_help_panel=_DRIVE)(flash)

app.command("view", rich_help_panel=_LOOK)(view)
recordings.command("fill")(fill_command)
app.add_typer(recordings, name="recordings", rich_help_panel=_LOOK)
app.command("report", rich_help_panel=_LOOK)(report)
app.command("film", rich_help_panel=_LOOK)(film)
app.command("replay", rich_help_panel=_LOOK)(replay)

app.command("check-model", rich_help_panel=_MODELS)(check_model_file)
app.command("push-model", rich_help_panel=_MODELS)(push_model)
app.command("models", rich_help_panel=_MODELS)(models)
app.command("rollback", rich_help_panel=_MODELS)(rollback)
app.command("update", rich_help_panel=_MODELS)(update)
app.add_typer(keys, name="keys", rich_help_panel=_MODELS)
app.command("enroll", rich_help_panel=_MODELS)(enroll)
app.command("setup-card", rich_help_panel=_MODELS)(setup_card)

app.command("train", rich_help_panel=_TRAIN)(train)
app.command("training-curve", rich_help_panel=_TRAIN)(training_curve)
app.command("evaluate", rich_help_panel=_TRAIN)(evaluate)
app.command("export", rich_help_panel=_TRAIN)(export)
app.command("explain", rich_help_panel=_TRAIN)(explain)
app.command("study", rich_help_panel=_TRAIN)(study)

app.add_typer(print_targets, name="print", rich_help_panel=_MEASURE)
app.add_typer(calibrate, name="calibrate", rich_help_panel=_MEASURE)
app.command("panorama", rich_help_panel=_MEASURE)(panorama)
app.add_typer(maneuvers, name="maneuvers", rich_help_panel=_MEASURE)
app.command("track", rich_help_panel=_MEASURE)(track)
app.command("identify", rich_help_panel=_MEASURE)(identify)
app.command("gap-report", rich_help_panel=_MEASURE)(gap_report)
