"""A panorama as the robot will see it in the simulation, in all directions."""

from pathlib import Path

from matplotlib.figure import Figure

from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.pictures.picture_file import save_figure
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.calibrated.calibration_folder import CalibrationFiles, read_files
from mbot_workstation.sim.camera.camera_renderer import CameraRenderer
from mbot_workstation.sim.camera.isp import IspSettings
from mbot_workstation.sim.camera.scene_renderer import SHOW
from mbot_workstation.sim.effects.isp_settings import isp_settings
from mbot_workstation.sim.pose import Pose
from mbot_workstation.sim.scene.scene_parameters import SceneParameters
from mbot_workstation.sim.simulation import Simulation

HEADINGS_DEG = (0, -45, -90, -135, 180, 135, 90, 45)
"""To the left; drawn from ahead clockwise, as the robot searches."""

WIDTH_PX = 320
CUBE_AHEAD_M = 1.0


def write_preview(folder: Path, name: str, room: Picture) -> Path:
    """Draw previews/NAME.png of a calibration, by what else is known of its robot.

    Raises:
        ConfigurationError: it can't be written.

    """
    known = read_files(folder) if folder.is_dir() else CalibrationFiles()
    path = folder / "previews" / f"{name}.png"
    try:
        path.parent.mkdir(exist_ok=True)
    except OSError as error:
        raise ConfigurationError(f"can't write {path}: {error.strerror}") from None
    draw_preview(room, known.robot, known.scene, isp_settings(known.effects).gains, path)
    return path


def draw_preview(
    room: Picture,
    robot: RobotParameters,
    scene: SceneParameters,
    gains: tuple[float, float, float],
    path: Path,
) -> None:
    """Write the panorama with its horizon, and eight views from the robot's height.

    Args:
        room: the level panorama.
        robot: whose camera looks, from the middle of the arena.
        scene: the light and the distance of the room.
        gains: of red, green and blue.
        path: a PNG, in a folder that exists.

    Raises:
        ConfigurationError: it can't be written.

    """
    import math

    simulation = Simulation(robot, scene, room)
    height_px = round(WIDTH_PX * robot.camera.height_px / robot.camera.width_px)
    views: list[Picture] = []
    with CameraRenderer(
        simulation, WIDTH_PX, height_px, SHOW, isp=IspSettings(gains=gains)
    ) as renderer:
        for heading_deg in HEADINGS_DEG:
            yaw = math.radians(heading_deg)
            simulation.place_robot(Pose(0, 0, yaw))
            simulation.place_object(
                Pose(CUBE_AHEAD_M * math.cos(yaw), CUBE_AHEAD_M * math.sin(yaw), yaw)
            )
            views.append(renderer.picture(simulation.snapshot()))
    figure = Figure(figsize=(13, 10.5), layout="constrained")
    grid = figure.add_gridspec(3, 4, height_ratios=[2.1, 1, 1])
    whole = figure.add_subplot(grid[0, :])
    whole.imshow(room, extent=(180, -180, -90, 90), aspect="auto")
    whole.axhline(0, color="white", linewidth=0.8, linestyle="--")
    whole.set_xticks(range(-180, 181, 45))
    whole.set_yticks(range(-90, 91, 30))
    whole.set_xlabel("degrees to the left of the robot's first heading")
    whole.set_title("the panorama; dashed: the horizon, where far things stand", fontsize=11)
    for number, (heading_deg, view) in enumerate(zip(HEADINGS_DEG, views, strict=True)):
        axes = figure.add_subplot(grid[1 + number // 4, number % 4])
        axes.imshow(view)
        axes.set_axis_off()
        axes.set_title(_words(heading_deg), fontsize=10)
    save_figure(figure, path, 90)


def _words(heading_deg: int) -> str:
    if heading_deg in {0, 180}:
        return "ahead" if heading_deg == 0 else "behind"
    return f"{abs(heading_deg)}° to the {'left' if heading_deg > 0 else 'right'}"
