"""tolerance.json: tolerance maps as numbers, for `workstation gap-report` and other programs."""

from itertools import pairwise
from pathlib import Path

import msgspec
from msgspec import Struct

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files import atomic_file

TOLERANCE_FILE = "tolerance.json"


class MapAxis(Struct, frozen=True, forbid_unknown_fields=True):
    """One of a map's two deviations.

    Attributes:
        name: of `study_plans.DEVIATIONS`.
        unit: of its values, in words.
        nominal: its value on the nominal robot.
        values: of the cells, ascending.

    Raises:
        ValueError: there are fewer than two values, or they do not rise.

    """

    name: str
    unit: str
    nominal: float
    values: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.values) < 2 or any(a >= b for a, b in pairwise(self.values)):
            raise ValueError(f"values of {self.name} are {list(self.values)}, expected rising ones")


class RewardMap(Struct, frozen=True, forbid_unknown_fields=True):
    """Mean rewards over two deviations.

    Attributes:
        across, up: the deviations.
        rewards: a row a value of `up`, lowest first, with a column a value of `across`.

    Raises:
        ValueError: rewards are not of that shape.

    """

    across: MapAxis
    up: MapAxis
    rewards: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        shape = len(self.up.values), len(self.across.values)
        if len(self.rewards) != shape[0] or any(len(row) != shape[1] for row in self.rewards):
            raise ValueError(f"rewards are not {shape[0]} rows of {shape[1]}")


class HomeMistakes(Struct, frozen=True, forbid_unknown_fields=True):
    """How often a policy makes one of its task's mistakes in homes, an episode.

    Attributes:
        name: the task's, such as "wrong_things".
        mean, low, high: with its 95 % interval.
        episodes: tried.

    """

    name: str
    mean: float
    low: float
    high: float
    episodes: int

    @property
    def words(self) -> str:
        """For people: "wrong things 2.1 (1.5 to 2.8) an episode"."""
        name = self.name.replace("_", " ")
        return f"{name} {self.mean:.1f} ({self.low:.1f} to {self.high:.1f}) an episode"


class Tolerances(Struct, frozen=True, forbid_unknown_fields=True):
    """The whole file.

    Attributes:
        contestant: whose: a policy's name.
        nominal_reward: its mean reward on the nominal robot.
        tolerated_share: of that reward, what must be left for a deviation to be tolerated.
        how: it was tried, in words.
        maps: see `RewardMap`.
        mistakes: in homes, on the nominal robot; files of before have none.

    Raises:
        ValueError: the nominal reward is not above 0, so that no share of it means anything.

    """

    contestant: str
    nominal_reward: float
    tolerated_share: float
    how: str
    maps: tuple[RewardMap, ...]
    mistakes: tuple[HomeMistakes, ...] = ()

    def __post_init__(self) -> None:
        if not self.nominal_reward > 0:
            raise ValueError(
                f"nominal_reward is {self.nominal_reward}, expected above 0: a policy that fails "
                "on the nominal robot tolerates nothing"
            )
        if not 0 < self.tolerated_share < 1:
            raise ValueError(f"tolerated_share is {self.tolerated_share}, expected 0 to 1")


def read_tolerances(path: Path) -> Tolerances:
    """Read a file that `workstation study tolerance` wrote.

    Raises:
        ConfigurationError: it can't be read, or is no such file.

    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ConfigurationError(f"can't read {path}: {error.strerror}") from None
    try:
        return msgspec.json.decode(content, type=Tolerances)
    except msgspec.DecodeError as error:
        raise ConfigurationError(
            f"{path} is no {TOLERANCE_FILE} of `workstation study tolerance`: {error}"
        ) from None


def write_tolerances(path: Path, tolerances: Tolerances) -> Path:
    """Write the file.

    Raises:
        ConfigurationError: it can't be written.

    """
    atomic_file.save(path, msgspec.json.format(msgspec.json.encode(tolerances)) + b"\n")
    return path
