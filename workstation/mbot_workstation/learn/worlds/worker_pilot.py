"""Who drives a worker's robots for many decisions in a row, in the worker's own process."""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.picture import Picture


class Pilot(Protocol):
    """Decides for all robots of a worker, n of them; handed over by pickle, before it has begun."""

    def start(self, task: Any) -> None:
        """Begin some decisions in a row; what a task is, is the pilot's own affair."""
        ...

    def decide(self, pictures: Picture) -> NDArray[np.float32]:
        """Both wheels in [-1, 1], shape (n, 2), for what is seen, shape (n, 64, 64, 3)."""
        ...

    def arrive(self, ended: NDArray[np.bool_]) -> None:
        """Be told whose episodes the decision has ended, shape (n,)."""
        ...

    def notes(self) -> Any:
        """What it wants to be known of the decisions since its start."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """Some decisions in a row of a worker's robots, shape (decisions, n); pictures are elsewhere.

    Attributes:
        situations: STEP_RECORD, at the moment that the pictures show.
        bodies: BODY_RECORD of the robots then.
        outcomes: STEP_RECORD, what each decision brought.
        notes: the pilot's.

    """

    situations: NDArray[np.void]
    bodies: NDArray[np.void]
    outcomes: NDArray[np.void]
    notes: Any
