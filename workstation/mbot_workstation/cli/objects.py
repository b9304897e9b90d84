"""Look at what there is to fetch, before a policy is trained for it."""

from dataclasses import dataclass
from pathlib import Path

from mbot_workstation.cli.common_options import json_option
from mbot_workstation.cli.options import argument, output_file, with_options
from mbot_workstation.cli.presenter import Answer
from mbot_workstation.wording import typed


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectOptions:
    """What `look_at_object` takes."""

    file: Path = argument("As for --object: docs/objects.md.", metavar="FILE.toml")
    output: Path = output_file(
        Path("object.png"),
        "The picture to write.",
        "--output",
        "-o",
        endings=(".png", ".jpg"),
        metavar="FILE.png",
    )
    as_json: bool = json_option()


@dataclass(frozen=True, slots=True)
class ObjectThere:
    """One kind of object as it stands on the floor, in m."""

    name: str
    shape: str
    width_m: float
    height_m: float


@dataclass(frozen=True, slots=True)
class ObjectsDrawn:
    """A picture of objects, and what they are."""

    path: Path
    objects: list[ObjectThere]


@with_options
def look_at_object(options: ObjectOptions) -> Answer:
    """Draw an object of yours: from four sides, and as the robot sees it from 0.3, 1 and 2 m.

    Example: `workstation object mug.toml -o mug.png`
    """
    from mbot_workstation.learn.worlds.object_preview import object_preview
    from mbot_workstation.pictures.picture_file import write_picture
    from mbot_workstation.sim.scene.object_file import read_objects

    kinds = read_objects(options.file)
    write_picture(options.output, object_preview(kinds))
    found = [ObjectThere(one.name, one.shape.value, one.width_m, one.height_m) for one in kinds]
    said = [
        f"{one.name}: {one.shape}, {1000 * one.width_m:.0f} mm wide, {1000 * one.height_m:.0f} mm "
        "high"
        for one in found
    ]
    said.append(
        f"wrote {options.output}; next: workstation train --from models/red-cube-run --object "
        f"{typed(options.file)}"
    )
    return Answer(ObjectsDrawn(options.output, found), said)
