"""What the robot's camera shows from marked places, with the cube: for the gap report's frames."""

import csv
import math
from pathlib import Path

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.gap_report.frames import CUBE, FRAMES_FILE, ROBOT
from mbot_workstation.measure.gap_report.simulated_view import Place, simulated_view
from mbot_workstation.measure.rehearsal.truth import true_room
from mbot_workstation.pictures.picture_file import write_picture
from mbot_workstation.sim.calibrated.calibration_folder import CalibrationFiles
from mbot_workstation.sim.camera.sensor_noise import SensorNoise
from mbot_workstation.sim.pose import ORIGIN, Pose

WIDTH_PX, HEIGHT_PX = 640, 480

PLACES = (
    Place(ORIGIN, Pose(0.9, 0.15, math.radians(20))),
    Place(Pose(0.5, -0.5, math.radians(120)), Pose(0.2, 0.7, 0.0)),
    Place(Pose(-0.8, 0.3, math.radians(-140))),
)


def take_frames(folder: Path, truth: CalibrationFiles, seed: int) -> None:
    """Write a picture from each of `PLACES`, and frames.csv.

    Raises:
        ConfigurationError: the folder can't be written.

    """
    noise = SensorNoise(WIDTH_PX, HEIGHT_PX, seed)
    rows: list[list[str]] = []
    with simulated_view(truth, true_room(), (WIDTH_PX, HEIGHT_PX)) as draw:
        for number, place in enumerate(PLACES, start=1):
            name = f"frame-{number}.jpg"
            write_picture(folder / name, noise.apply(draw(place)))
            rows.append([name, *_fields(place.robot), *(_fields(place.cube) or [""] * len(CUBE))])
    try:
        with (folder / FRAMES_FILE).open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows([["file", *ROBOT, *CUBE], *rows])
    except OSError as error:
        raise ConfigurationError(f"can't write to {folder}: {error.strerror}") from None


def _fields(pose: Pose | None) -> list[str]:
    if pose is None:
        return []
    return [f"{pose.x_m:g}", f"{pose.y_m:g}", f"{math.degrees(pose.yaw_rad):g}"]
