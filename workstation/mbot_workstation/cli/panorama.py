"""`workstation panorama`: the robot's own room for the simulation."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mbot_workstation.cli.link_options import json_option
from mbot_workstation.cli.options import argument, option, with_options
from mbot_workstation.cli.simulation_options import calibration_output_option

if TYPE_CHECKING:
    from mbot_workstation.measure.calibration.room.panorama_import import ImportedRoom


@dataclass(frozen=True, slots=True, kw_only=True)
class PanoramaOptions:
    """What `panorama` takes."""

    photo: Path = argument("A 360-degree photo, twice as wide as high.", metavar="PHOTO")
    calibration: Path = calibration_output_option()
    name: str | None = option(None, "Of the room; the photo's if not given.", metavar="NAME")
    heading: float = option(
        0.0,
        "Where the robot looks first, to the right of the photo's middle.",
        metavar="DEGREES",
        min=-360,
        max=360,
    )
    pitch: float | None = option(
        None,
        "How far the photo's middle is above the horizon; with --roll, instead of asking "
        "the upright edges.",
        metavar="DEGREES",
        min=-45,
        max=45,
    )
    roll: float | None = option(
        None, "How far the camera was turned clockwise.", metavar="DEGREES", min=-45, max=45
    )
    width: int | None = option(
        None,
        "A power of two; if not given, what the photo fills, up to 2048: as fine as the "
        "robot's camera sees. Each simulation keeps the room in memory.",
        metavar="PIXELS",
    )
    force: bool = option(False, "Take it even if it doesn't look like a whole panorama.", "--force")
    as_json: bool = json_option()


@with_options
def panorama(options: PanoramaOptions) -> None:
    """Check a 360-degree photo, level and turn it, and keep it as a room of the calibration.

    Take it from the middle of the arena, from a tripod at about 1.2 m, with the light as it is when
    the robot drives. It goes to rooms/NAME.jpg, and previews/NAME.png shows what the robot will
    see. `workstation train --calibration` and `virtual-robot --calibration` use it then.

    Examples:

    - `workstation panorama my-room.jpg`
    - `workstation panorama R0010042.JPG --name lab --heading 90 --calibration calibration/mbot-2`
    """
    from mbot_protocol.errors import ConfigurationError
    from mbot_workstation.measure.calibration.room.panorama_import import (
        check_width,
        prepare_room,
        write_room,
    )
    from mbot_workstation.measure.calibration.room.panorama_preview import draw_preview
    from mbot_workstation.sim.calibrated.calibration_folder import CalibrationFiles, read_files
    from mbot_workstation.sim.effects.isp_settings import isp_settings

    if options.width is not None:
        check_width(options.width)
    tilt = (
        None
        if options.pitch is None and options.roll is None
        else (options.pitch or 0.0, options.roll or 0.0)
    )
    called = options.photo.stem if options.name is None else options.name
    if not called or called.startswith(".") or Path(called).name != called:
        raise ConfigurationError(f"--name is {called!r}, expected a plain name such as lab")
    room = prepare_room(
        options.photo,
        width_px=options.width,
        heading_deg=options.heading,
        tilt_deg=tilt,
        whole=not options.force,
    )
    known = read_files(options.calibration) if options.calibration.is_dir() else CalibrationFiles()
    path = write_room(options.calibration, called, room.picture)
    preview = options.calibration / "previews" / f"{called}.png"
    try:
        preview.parent.mkdir(exist_ok=True)
    except OSError as error:
        raise ConfigurationError(f"can't write {preview}: {error.strerror}") from None
    gains = isp_settings(known.effects).gains
    draw_preview(room.picture, known.robot, known.scene, gains, preview)
    if options.as_json:
        import json

        print(json.dumps(_fields(room, path, preview), indent=2))
        return
    print(_words(room, given=tilt is not None))
    for note in room.notes:
        print(f"note: {note}")
    print(f"wrote {path}, {room.picture.shape[1]} x {room.picture.shape[0]}")
    print(f"wrote {preview}: look whether it is level, and not mirrored")


def _words(room: "ImportedRoom", *, given: bool) -> str:
    tilt = f"pitch {room.pitch_deg:+.1f}, roll {room.roll_deg:+.1f} degrees"
    if given:
        return f"levelled by {tilt}, as given"
    if room.tilt is None:
        return "not levelled"
    if room.pitch_deg == room.roll_deg == 0:
        return f"level already, as {room.tilt.edges} upright edges say"
    return f"levelled by {tilt}, as {room.tilt.edges} upright edges say"


def _fields(room: "ImportedRoom", path: Path, preview: Path) -> dict[str, Any]:
    return {
        "pitch_deg": room.pitch_deg,
        "roll_deg": room.roll_deg,
        "upright_edges": room.tilt.edges if room.tilt else 0,
        "width_px": room.picture.shape[1],
        "height_px": room.picture.shape[0],
        "notes": list(room.notes),
        "path": str(path),
        "preview": str(preview),
    }
