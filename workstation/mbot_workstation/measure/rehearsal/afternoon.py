"""The afternoon of measuring, step by step, each by the command a person would type."""

import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console

from mbot_protocol.drive.picture import Picture
from mbot_workstation.fresh_folder import make_fresh
from mbot_workstation.measure.rehearsal.command_line import CommandLine
from mbot_workstation.measure.rehearsal.driving import (
    ROBOT_ID,
    drive_session,
    leave_out_spoilt,
    robot_pair,
)
from mbot_workstation.measure.rehearsal.outcome import Row, outcome
from mbot_workstation.measure.rehearsal.photographs import (
    CARD_PHOTO_PX,
    board_photos,
    card_photos,
    take_frames,
)
from mbot_workstation.measure.rehearsal.truth import (
    BODY,
    MOTION,
    TRUTH,
    WORN,
    WORN_MOTION,
    corrected,
    true_room,
    write_truth,
)
from mbot_workstation.measure.tracks.maneuver import MANEUVERS
from mbot_workstation.pictures.picture_file import write_picture
from mbot_workstation.sim.calibrated.calibration_folder import read_files
from mbot_workstation.sim.calibrated.toml_writer import write_toml

CALIBRATION = f"calibration/{ROBOT_ID}"
RECORDING = f"recordings/{ROBOT_ID}"
INTO = ("--calibration", CALIBRATION)
TRACK = "track.csv"
REPORT = "gap.html"
TRUTH_FOLDER = "truth"
CORRECTED_FOLDER = "truth-corrected"
"""The true robot once more, with the motor maps that were found: what policies are judged on."""
LEAVES = (
    *("board.pdf", "calibration", "components.toml", "frames", REPORT, "gray-card.pdf", "log"),
    *("marker.pdf", "photos", "ready.json", "recordings", "robot.toml", TRACK, CORRECTED_FOLDER),
)
"""What a rehearsal leaves beside the truth."""

ROOM_HEADING_DEG = 45.0
"""The tape on the floor, to the right of the photograph's middle."""

_BETWEEN_RUNS_S = 3.7
"""Beside the pause: standing before and after, stopping, saving."""


@dataclass(frozen=True, slots=True)
class Afternoon:
    """How much of it.

    Attributes:
        folder: where everything is left; emptied first.
        seconds, repetitions, pause_s: of each maneuver; the paper has 10, 10.
        maneuvers: which; all eight if empty.
        photos: of the board.
        worn: whether the robot is a worn one.
        tolerance: a tolerance map to hold the result against.
        seed: of everything that is drawn.

    """

    folder: Path
    seconds: float
    repetitions: int
    pause_s: float = 2.5
    maneuvers: tuple[str, ...] = ()
    photos: int = 20
    worn: bool = False
    tolerance: Path | None = None
    seed: int = 1


def rehearse(afternoon: Afternoon, console: Console) -> tuple[Row, ...]:
    """Measure a virtual robot as a person would a real one; the truth is opened at the end only.

    Returns:
        What was found, beside the truth.

    Raises:
        MbotError: a step failed.

    """
    folder = afternoon.folder.absolute()
    make_fresh(folder, TRUTH_FOLDER, LEAVES)
    (folder / "log").mkdir()
    motion = WORN_MOTION if afternoon.worn else MOTION
    write_truth(folder / TRUTH_FOLDER, motion)
    line = CommandLine(folder, console)
    _print_targets(line)
    _weigh(line)
    _photograph_board(line, afternoon)
    _photograph_card(line, afternoon)
    _photograph_room(line)
    _drive(line, afternoon)
    _identify(line)
    _report(line, afternoon)
    found = read_files(folder / CALIBRATION)
    if found.motion is not None:
        write_truth(folder / CORRECTED_FOLDER, corrected(motion, found.motion))
    return outcome(WORN if afternoon.worn else TRUTH, found)


def _print_targets(line: CommandLine) -> None:
    line.step("1. Print", "A board for the camera, a frame for the gray card, a marker to track.")
    for what in ("board", "gray-card", "marker"):
        line.run("workstation", "print", what, "-o", f"{what}.pdf", quiet=True)


def _weigh(line: CommandLine) -> None:
    line.step("2. Weigh and measure", "Every part on the kitchen scale, its place by ruler.")
    line.run("workstation", "calibrate", "body", "--example", to="components.toml")
    line.say("here a person fills in components.toml")
    write_toml(line.folder / "components.toml", BODY, "Weighed and measured by hand.")
    line.run("workstation", "calibrate", "body", "components.toml", *INTO)


def _photograph_board(line: CommandLine, afternoon: Afternoon) -> None:
    words = f"{afternoon.photos} photographs of the board by the robot's own camera."
    line.step("3. The lens", words)
    camera = TRUTH.robot.camera.scaled_to(*CARD_PHOTO_PX)
    _save_all(line, "board", board_photos(camera, afternoon.photos, afternoon.seed))
    line.run("workstation", "calibrate", "camera", "photos/board", *INTO)


def _photograph_card(line: CommandLine, afternoon: Afternoon) -> None:
    line.step("4. The light", "A gray card in its printed frame, turned every way.")
    _save_all(line, "gray", card_photos(TRUTH, afternoon.seed))
    line.run("workstation", "calibrate", "light", "photos/gray", *INTO)


def _photograph_room(line: CommandLine) -> None:
    line.step("5. The room", "One 360-degree photograph from the middle of the floor.")
    # Nobody points such a camera's middle exactly along the tape on the floor.
    room = true_room()
    photo = np.roll(room, round(ROOM_HEADING_DEG / 360 * room.shape[1]), axis=1)
    write_picture(line.folder / "photos" / "room.jpg", photo)
    heading = f"{ROOM_HEADING_DEG:g}"
    line.run("workstation", "panorama", "photos/room.jpg", "--heading", heading, *INTO)


def _save_all(line: CommandLine, name: str, pictures: Iterable[Picture]) -> None:
    count = 0
    with line.console.status(f"taking photos/{name}"):
        for count, picture in enumerate(pictures, start=1):
            write_picture(line.folder / "photos" / name / f"{name}-{count:02}.jpg", picture)
    line.say(f"{count} photographs in photos/{name}")


def _drive(line: CommandLine, afternoon: Afternoon) -> None:
    runs = (len(afternoon.maneuvers) or len(MANEUVERS)) * afternoon.repetitions
    each_s = afternoon.seconds + afternoon.pause_s + _BETWEEN_RUNS_S
    line.step(
        "6. Drive", f"{runs} runs, about {runs * each_s / 60:.0f} min, with a tracker on the robot."
    )
    with robot_pair(line, line.folder / TRUTH_FOLDER, TRACK) as address:
        drive_session(
            line,
            RECORDING,
            *("--robot", address, "--yes", "--seconds", f"{afternoon.seconds:g}"),
            *("--repetitions", str(afternoon.repetitions), "--pause", f"{afternoon.pause_s:g}"),
            *(word for name in afternoon.maneuvers for word in ("--maneuver", name)),
        )
    recording = line.folder / RECORDING
    line.show(["mv", TRACK, f"{RECORDING}/"])
    shutil.move(line.folder / TRACK, recording / TRACK)
    line.show(["echo", 'preset = "triad-openvr"'], f" > {RECORDING}/track.toml")
    (recording / "track.toml").write_text('preset = "triad-openvr"\n', encoding="utf-8")
    if spoilt := leave_out_spoilt(recording):
        numbers = ", ".join(map(str, spoilt))
        line.say(f"the tracker was lost in run {numbers}: leave_out in recording.toml")


def _identify(line: CommandLine) -> None:
    line.step("7. Identify", "Half of the repetitions are fitted, the others held out.")
    line.run("workstation", "identify", RECORDING, *INTO)


def _report(line: CommandLine, afternoon: Afternoon) -> None:
    line.step("8. Report the gap", "Three frames from marked places, then the page.")
    take_frames(line.folder / "frames", TRUTH, afternoon.seed)
    line.say("3 photographs from marked places in frames, their places in frames/frames.csv")
    tolerance = () if afternoon.tolerance is None else ("--tolerance", str(afternoon.tolerance))
    line.run(
        *("workstation", "gap-report", RECORDING, *INTO),
        *("--frames", "frames", *tolerance, "-o", REPORT),
    )
