"""`workstation calibrate`: measurements of one robot, each a file of its calibration folder."""

import typer

from mbot_workstation.cli.calibrate_body import body
from mbot_workstation.cli.calibrate_camera import camera
from mbot_workstation.cli.calibrate_demo import calibrate_demo
from mbot_workstation.cli.calibrate_light import light

app = typer.Typer(
    help="Measure one robot; simulation, training and the daemon then use what is written.",
    no_args_is_help=True,
    rich_markup_mode="markdown",
)

app.command("body")(body)
app.command("camera")(camera)
app.command("light")(light)
app.command("demo")(calibrate_demo)
