"""What is unknown of a run and its recording, and the terms it adds to a fit."""

from dataclasses import dataclass

from mbot_workstation.recordings.track import Array

SETTING = ("ahead_s", "drift", "tracker_ahead_m", "tracker_left_m", "tracker_yaw_rad")
"""What is unknown of a recording: its clock, beyond what was guessed, and its tracker."""

POSE = 3
"""x, y, yaw at the start: what is unknown of every run."""

OWN = ("strength", "left_strength", "right_strength", "moment_s", "ahead_m", "left_m")
"""A run's own deviations: of both motors alike and of each, as shares of their gain; of the
beginning; of the tracker's place. Then follow those of each motor in each piece of the run."""

STRENGTH, SIDES, MOMENT, PLACE = 0, slice(1, 3), 3, slice(4, 6)
"""Where in `OWN`."""


@dataclass(frozen=True, slots=True, eq=False)
class Residual:
    """Measured minus simulated, averaged over bins: places' x, places' y, headings.

    Attributes:
        value: shape (3, bins): [m], [m], [rad].
        samples: how many samples each is worth, shape (3, bins).
        weights: of the samples, shape (3, n).
        scatter: standard deviations of single samples: place [m], heading [rad].

    """

    value: Array
    samples: Array
    weights: Array
    scatter: tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Slopes:
    """By what the simulated measurements change.

    Attributes:
        common: by the parameters, then the recording's `SETTING`, shape (n + 5, 3, bins).
        pose: by the starting pose, shape (3, 3, bins).
        own: by the run's own deviations, shape (deviations, 3, bins).

    """

    common: Array
    pose: Array
    own: Array
