"""What the page can't show, and the command that would make it."""

from collections.abc import Sequence
from pathlib import Path

from mbot_protocol.calibration import CAMERA_FILE, MOTION_FILE
from mbot_workstation.calibration_files.body_calibration import BODY_FILE
from mbot_workstation.calibration_files.calibration_folder import CalibrationFiles, room_pictures
from mbot_workstation.calibration_files.light_calibration import LIGHT_FILE
from mbot_workstation.gap_report.quantity import DEVIATIONS_OF_QUANTITIES
from mbot_workstation.gap_report.report import Missing
from mbot_workstation.recordings.maneuver import MANEUVERS
from mbot_workstation.training.studies.tolerance_file import Tolerances


def missing_parts(
    files: CalibrationFiles,
    recording: Path,
    maneuvers: Sequence[str],
    *,
    tolerances: Tolerances | None,
    has_frames: bool,
) -> tuple[Missing, ...]:
    """Everything, in the order of the afternoon.

    Args:
        files: the calibration, read from a folder.
        recording: one of the recordings.
        maneuvers: those that were driven.
        tolerances: the maps that were given.
        has_frames: whether there are pictures.

    """
    return (
        *_of_calibration(files),
        *_of_driving(files, recording, maneuvers, has_frames=has_frames),
        *_of_tolerances(tolerances),
    )


def _of_calibration(files: CalibrationFiles) -> list[Missing]:
    folder = files.folder
    into = f"--calibration {folder}"
    found: list[Missing] = []
    if files.body is None:
        found.append(
            Missing(
                f"no {BODY_FILE}: masses and the camera's mounting are the nominal robot's",
                f"workstation calibrate body COMPONENTS.toml {into}",
            )
        )
    if files.camera is None:
        found.append(
            Missing(
                f"no {CAMERA_FILE}: the lens is the data sheet's, its error is not known",
                f"workstation calibrate camera PHOTOS {into}",
            )
        )
    if files.light is None:
        found.append(
            Missing(
                f"no {LIGHT_FILE}: exposure and white balance are nominal, the gray card's error "
                "is not known",
                f"workstation calibrate light PHOTOS {into}",
            )
        )
    if not room_pictures(Path(folder)):
        found.append(
            Missing(
                "no panorama: simulated pictures show a made-up room",
                f"workstation panorama PHOTO.jpg {into}",
            )
        )
    return found


def _of_driving(
    files: CalibrationFiles, recording: Path, maneuvers: Sequence[str], *, has_frames: bool
) -> list[Missing]:
    found: list[Missing] = []
    absent = [one.name for one in MANEUVERS if one.name not in maneuvers]
    if absent:
        names = " ".join(f"--maneuver {name}" for name in absent)
        found.append(
            Missing(
                f"no runs of {', '.join(absent)}",
                f"workstation maneuvers run --resume {recording} {names}",
            )
        )
    if files.motion is None:
        found.append(
            Missing(
                f"no {MOTION_FILE}: the simulated motors are nominal, so both simulations drive "
                "alike",
                f"workstation identify {recording} --calibration {files.folder}",
            )
        )
    if not has_frames:
        found.append(
            Missing(
                "no frame of the real camera with its place",
                "workstation gap-report ... --frames FOLDER",
            )
        )
    return found


def _of_tolerances(tolerances: Tolerances | None) -> list[Missing]:
    if tolerances is None:
        return [
            Missing(
                "no tolerance map, hence no verdicts: nobody has tried what the policy bears",
                "workstation study tolerance POLICY.onnx -o FOLDER, then --tolerance "
                "FOLDER/tolerance.json",
            )
        ]
    known = {axis.name for one in tolerances.maps for axis in (one.across, one.up)}
    absent = [name for name in DEVIATIONS_OF_QUANTITIES if name not in known]
    if not absent:
        return []
    pairs = " ".join(f"--pair '{name}:exposure_ms'" for name in absent)
    return [
        Missing(
            f"no tolerance map over {', '.join(absent)}",
            f"workstation study tolerance POLICY.onnx {pairs}",
        )
    ]
