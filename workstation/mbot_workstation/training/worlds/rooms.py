"""The rooms to train and to be tried in: photographs, and made-up ones."""

from collections.abc import Sequence
from pathlib import Path

from mbot_protocol.picture import Picture
from mbot_workstation.simulation.room import load_room
from mbot_workstation.simulation.room_generator import generate_room

TRAINING_ROOMS = 1000
EVALUATION_ROOMS = 2000
"""Seeds of the first made-up room of each kind: nobody is tried in a room trained in."""


def gather_rooms(panoramas: Sequence[Path], made_up: int, first_seed: int) -> list[Picture]:
    """The photographs, then made-up rooms.

    Raises:
        ConfigurationError: a photograph is unusable.

    """
    photographs = [load_room(path) for path in panoramas]
    return [*photographs, *(generate_room(first_seed + number) for number in range(made_up))]
