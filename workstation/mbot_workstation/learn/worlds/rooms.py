"""The rooms to train and to be tried in: photographs, and made-up ones."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mbot_protocol.drive.picture import Picture
from mbot_workstation.sim.effects.scene_looks import like_an_object
from mbot_workstation.sim.scene.room import load_room
from mbot_workstation.sim.scene.room_generator import generate_room
from mbot_workstation.sim.scene.target_object import TargetObject

TRAINING_ROOMS = 1000
EVALUATION_ROOMS = 2000
CHOICE_ROOMS = 3000
"""Seeds of the first made-up room of each kind: nobody is tried in a room trained in."""

_PHOTOGRAPHS = Path(__file__).parent / "photographs"
TRAINING_PHOTOGRAPHS = sorted((_PHOTOGRAPHS / "training").glob("*.jpg"))
EVALUATION_PHOTOGRAPHS = sorted((_PHOTOGRAPHS / "evaluation").glob("*.jpg"))
"""Files that ship with the project, for people without photographs of their own."""

EVALUATION_MADE_UP = 4
"""Made-up rooms besides those photographs."""


def gather_rooms(panoramas: Sequence[Path], made_up: int, first_seed: int) -> list[Picture]:
    """The photographs, then made-up rooms.

    Raises:
        ConfigurationError: a photograph is unusable.

    """
    photographs = [load_room(path) for path in panoramas]
    return [*photographs, *(generate_room(first_seed + number) for number in range(made_up))]


def training_rooms(
    photographs: Sequence[Path], made_up: int, objects: Sequence[TargetObject]
) -> list[Picture]:
    """Rooms to train in: the photographs, then made-up ones, every second with a wall of an
    object's colour. Homes have such walls; a policy that had seen none ended a drive before one.

    Raises:
        ConfigurationError: a photograph is unusable.

    """
    rooms = gather_rooms(photographs, 0, TRAINING_ROOMS)
    for number in range(made_up):
        seed = TRAINING_ROOMS + number
        wall = np.multiply(255, like_an_object(np.random.default_rng(seed), objects)).tolist()
        rooms.append(generate_room(seed, wall_rgb=tuple(wall) if number % 2 == 0 else None))
    return rooms


def evaluation_rooms(panoramas: Sequence[Path], made_up: int | None = None) -> list[Picture]:
    """Rooms to try policies in, none of which training uses.

    Args:
        panoramas: a user's photographs; without any, those that ship with the project.
        made_up: how many made-up rooms besides; None is 0 with a user's photographs, else 4.

    Raises:
        ConfigurationError: a photograph is unusable.

    """
    if panoramas:
        return gather_rooms(panoramas, made_up or 0, EVALUATION_ROOMS)
    several = EVALUATION_MADE_UP if made_up is None else made_up
    return gather_rooms(EVALUATION_PHOTOGRAPHS, several, EVALUATION_ROOMS)
