"""`workstation calibrate light`: exposure, white balance and light from a gray card."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mbot_workstation.cli.link_options import json_option
from mbot_workstation.cli.options import argument, option, with_options
from mbot_workstation.cli.simulation_options import calibration_output_option

if TYPE_CHECKING:
    from mbot_workstation.measure.calibration.light.light_measurement import LightMeasurement
    from mbot_workstation.sim.body.robot_parameters import RobotParameters


@dataclass(frozen=True, slots=True, kw_only=True)
class LightOptions:
    """What `light` takes."""

    photos: list[Path] = argument(
        "Photographs of the card, or a folder of them.", metavar="PHOTO..."
    )
    calibration: Path = calibration_output_option()
    card: str | None = option(
        None,
        "Where the card is in the photographs, in pixels; found by itself if not given.",
        metavar="X,Y,WIDTH,HEIGHT",
    )
    card_mm: tuple[float, float] = option(
        (127.0, 102.0), "Of the card in its printed frame.", metavar="WIDTH HEIGHT"
    )
    reflectance: float = option(18.0, "Of the gray card.", metavar="PERCENT", min=3, max=95)
    three_patches: bool = option(
        False, "The card is white, gray and black side by side.", "--three-patches"
    )
    facing: list[str] | None = option(
        None,
        "Without the frame: how far the card is turned to the robot's left from facing "
        "the robot, and tilted up, in degrees; once a photograph, in their order.",
        metavar="LEFT:UP",
    )
    heading: float = option(
        0.0,
        "Where the robot looked, to the left of the middle of its room's panorama.",
        metavar="DEGREES",
        min=-360,
        max=360,
    )
    as_json: bool = json_option()


@with_options
def light(options: LightOptions) -> None:
    """Match the simulation's light to photographs of a gray card, and write light.toml.

    Put the card into the frame of `workstation print gray-card`. Let the robot stand at its start
    and photograph the card half a metre ahead with its own camera, exposure and white balance as
    when it drives: at least four times, the card turned left, right, up and towards the window or
    lamp. In one facing only exposure and white balance can be told.

    Examples:

    - `workstation calibrate light gray/*.jpg`
    - `workstation calibrate light a.png b.png c.png d.png --card 140,90,40,40
      --facing 0:0 --facing 45:0 --facing -45:0 --facing 0:50`
    """
    from rich.console import Console
    from rich.progress import Progress

    from mbot_workstation.measure.calibration.light.light_measurement import (
        CardSettings,
        measure_light,
    )
    from mbot_workstation.pictures.picture_file import picture_files

    settings = CardSettings(
        options.card_mm,
        options.reflectance / 100,
        options.three_patches,
        _rectangle(options.card),
        tuple(_facing(text) for text in options.facing or ()),
    )
    files = picture_files(options.photos)
    robot = _robot(options.calibration)
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("looking for the gray card", total=len(files))
        measured = measure_light(
            files, robot, settings, lambda done: progress.update(task, completed=done)
        )
    path = _write(measured, options.calibration, options.heading)
    if options.as_json:
        import json

        print(json.dumps(_fields(measured, path, options.heading), indent=2))
        return
    _print(measured)
    print(f"wrote {path} and {path.with_name('light.png').name}")


def _robot(folder: Path) -> "RobotParameters":
    from mbot_workstation.sim.body.robot_parameters import RobotParameters
    from mbot_workstation.sim.calibrated.calibration_folder import read_calibration

    return read_calibration(folder).robot if folder.is_dir() else RobotParameters()


def _rectangle(text: str | None) -> tuple[int, int, int, int] | None:
    from mbot_protocol.errors import ConfigurationError

    if text is None:
        return None
    parts = text.split(",")
    if len(parts) != 4 or not all(part.strip().isdecimal() for part in parts):
        raise ConfigurationError(
            f"--card is {text!r}, expected X,Y,WIDTH,HEIGHT such as 140,90,40,40"
        )
    left, top, width, height = (int(part) for part in parts)
    return left, top, width, height


def _facing(text: str) -> tuple[float, float]:
    from mbot_protocol.errors import ConfigurationError

    left, separator, up = text.partition(":")
    try:
        turned = float(left), float(up) if separator else 0.0
    except ValueError:
        turned = (float("nan"), 0.0)
    if not (abs(turned[0]) <= 89 and abs(turned[1]) <= 90):  # also false for NaN
        raise ConfigurationError(
            f"--facing is {text!r}, expected LEFT:UP in degrees such as 45:0 or 0:-30, up to 89 "
            "and 90: beyond, the camera can't see the card"
        )
    return turned


def _write(measured: "LightMeasurement", folder: Path, heading_deg: float) -> Path:
    from datetime import datetime

    from mbot_protocol.errors import ConfigurationError
    from mbot_workstation.measure.calibration.light.light_drawing import draw_light
    from mbot_workstation.measure.calibration.light.light_measurement import turned
    from mbot_workstation.sim.calibrated.calibration_folder import write_light
    from mbot_workstation.sim.calibrated.light_calibration import LightCalibration

    fit = measured.fit
    light = fit.light if fit.undetermined else turned(fit.light, heading_deg)
    try:
        result = LightCalibration(
            exposure_gain=fit.exposure_gain,
            red_gain=fit.red_gain,
            blue_gain=fit.blue_gain,
            direction=light.direction,
            ambient=light.ambient,
            delta_e_before=float(measured.differences_before.mean()),
            delta_e_after=float(measured.differences_after.mean()),
            pictures=len(measured.readings),
            made_on=datetime.now().astimezone().date().isoformat(),
        )
    except ValueError as error:
        raise ConfigurationError(f"these photographs give no usable light: {error}") from None
    path = write_light(folder, result)
    draw_light(measured, folder / "light.png")
    return path


def _print(measured: "LightMeasurement") -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    table = Table(box=None, padding=(0, 2, 0, 0))
    headings = ("photograph", "levels", "turned", "simulated", "off by", "calibrated", "off by")
    for heading in headings:
        table.add_column(heading, justify="left" if heading == "photograph" else "right")
    for index, reading in enumerate(measured.readings):
        table.add_row(
            escape(reading.name),
            _levels(reading.rgb),
            _turn_words(measured.normals[index]),
            _levels(measured.before[index]),
            f"{measured.differences_before[index]:.1f}",
            _levels(measured.after[index]),
            f"{measured.differences_after[index]:.1f}",
        )
    console = Console()
    console.print(table, width=None if console.is_terminal else 200)
    fit = measured.fit
    print(
        f"exposure {fit.exposure_gain:.3f}, red {fit.red_gain:.3f}, blue {fit.blue_gain:.3f} "
        "against the simulation's"
    )
    if fit.undetermined is None:
        x, y, z = fit.light.direction
        print(
            f"light shines towards {x:+.2f}, {y:+.2f}, {z:+.2f} (ahead, left, up; +-"
            f"{fit.direction_deg:.0f} degrees), {100 * fit.light.ambient:.0f} % from all sides"
        )
    else:
        print(f"the light's direction can't be told and stays nominal: {fit.undetermined}")
    print(
        f"colour difference (CIEDE2000) {measured.differences_before.mean():.1f} before, "
        f"{measured.differences_after.mean():.1f} after"
    )
    for note in measured.notes:
        print(f"note: {note}")


def _levels(rgb: Any) -> str:
    return " ".join(f"{value:.0f}" for value in rgb)


def _turn_words(normal: Any) -> str:
    """How far a card is turned left and up, as --facing takes it."""
    import math

    if normal is None:
        return "?"
    left = math.degrees(math.atan2(normal[1], -normal[0]))
    up = math.degrees(math.asin(max(-1.0, min(1.0, normal[2]))))
    return f"{round(left)}:{round(up)}"


def _fields(measured: "LightMeasurement", path: Path, heading_deg: float) -> dict[str, Any]:
    from mbot_workstation.measure.calibration.light.light_measurement import turned

    fit = measured.fit
    light = fit.light if fit.undetermined else turned(fit.light, heading_deg)
    return {
        "exposure_gain": fit.exposure_gain,
        "red_gain": fit.red_gain,
        "blue_gain": fit.blue_gain,
        "direction": list(light.direction),
        "direction_known_to_deg": fit.direction_deg,
        "ambient": light.ambient,
        "undetermined": fit.undetermined,
        "delta_e_before": float(measured.differences_before.mean()),
        "delta_e_after": float(measured.differences_after.mean()),
        "photographs": [
            {
                "name": reading.name,
                "rgb": reading.rgb.tolist(),
                "turned": _turn_words(measured.normals[index]),
                "delta_e_before": float(measured.differences_before[index]),
                "delta_e_after": float(measured.differences_after[index]),
            }
            for index, reading in enumerate(measured.readings)
        ],
        "notes": list(measured.notes),
        "path": str(path),
    }
