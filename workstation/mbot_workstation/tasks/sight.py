"""What pictures of a task show: for a network that learns to see before it drives."""

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from mbot_workstation.sim.pose import Pose


class Sight(Protocol):
    """Free labels: in a simulation it is known what a picture shows."""

    def scatter(self, episode: Any, rng: np.random.Generator) -> Pose:
        """Put what there is to see elsewhere, and say from where a picture is taken; the episode
        can't go on then.
        """
        ...

    def shown(self, facts: "np.ndarray[Any, np.dtype[np.void]]") -> NDArray[np.float32]:
        """What pictures show of which the task says these facts, shape (n,).

        Returns:
            Shape (n, 1 + k): 1.0 where one shows what matters, else 0.0; then k numbers of it,
            about 1 in size, of no account where it shows nothing.

        """
        ...

    def mirrored(self, shown: NDArray[np.float32]) -> NDArray[np.float32]:
        """What the same pictures show when left and right are exchanged."""
        ...
