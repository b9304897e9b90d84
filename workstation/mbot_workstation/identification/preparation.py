"""From recordings to runs that can be fitted: clocks guessed, unusable runs found and named."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.identification.first_guess import FirstGuess, first_guess, gain_of
from mbot_workstation.identification.flat_track import flatten
from mbot_workstation.identification.linearisation import Fixed
from mbot_workstation.identification.parameters import with_values
from mbot_workstation.identification.run_view import RunView
from mbot_workstation.recordings.run import Recording
from mbot_workstation.simulation.robot_parameters import RobotParameters

LEAST_COVERED = 0.85
"""Of a run's driving that its track must cover."""

SAME_CLOCK_S = 0.5
"""Clocks said to be one may differ by what the wheels and the tracker take, not by more."""


@dataclass(frozen=True, slots=True)
class Prepared:
    """Runs of all recordings.

    Attributes:
        views: those that can be used.
        robot: with the wheels and the track of the first guess.
        fixed: what is left alone, and the first guess of the rest.
        left_out: by the run's name, why.

    """

    views: tuple[RunView, ...]
    robot: RobotParameters
    fixed: Fixed
    left_out: dict[str, str]


def prepare(
    recordings: Sequence[Recording], robot: RobotParameters, *, same_clock: bool = False
) -> Prepared:
    """Look at all recordings of one robot.

    Args:
        recordings: at least one.
        robot: as far as it is known.
        same_clock: the trackers' times are the robot's clock.

    Raises:
        ConfigurationError: nothing can be fitted, and why.

    """
    views: list[RunView] = []
    guesses: list[FirstGuess] = []
    left_out: dict[str, str] = {}
    settings, free = [], []
    for index, recording in enumerate(recordings):
        if same_clock:
            _check_same_clock(recording)
        flat = flatten(recording, index)
        guess = first_guess(flat, robot, recording.wheel_maps, recording.tracker_ahead_s)
        guesses.append(guess)
        own_clock = recording.tracker_ahead_s is None
        middle_s = float(np.mean([run.run.commands.start_s for run in flat]))
        for number, run in enumerate(flat):
            why = guess.stray.get(number)
            if why is None:
                view = RunView(
                    run,
                    recording.wheel_maps,
                    middle_s,
                    float(guess.ahead_s[number]),
                    own_clock=own_clock,
                )
                why = _cut_short(view)
                if why is None:
                    views.append(view)
            if why is not None:
                left_out[_named(run.name, index, recordings)] = why
        settings.append([0.0, 0.0, guess.tracker.real, guess.tracker.imag, guess.tracker_yaw_rad])
        free.append([not own_clock, not own_clock and not same_clock, True, True, True])
    if not views:
        first, why = next(iter(left_out.items()))
        raise ConfigurationError(f"none of the runs can be used; {first}: {why}")
    fixed = Fixed(np.array(settings), np.array(free, dtype=np.float64))
    return Prepared(tuple(views), _guessed(robot, guesses), fixed, left_out)


def _guessed(robot: RobotParameters, guesses: Sequence[FirstGuess]) -> RobotParameters:
    left = [guess.left_m_s for guess in guesses if guess.left_m_s is not None]
    right = [guess.right_m_s for guess in guesses if guess.right_m_s is not None]
    track = [guess.track_m for guess in guesses if guess.track_m is not None]
    values: dict[str, float] = {}
    if left:
        values["left_gain"] = gain_of(float(np.median(left)), robot)
    if right:
        values["right_gain"] = gain_of(float(np.median(right)), robot)
    if track:
        values["track_m"] = float(np.median(track))
    return with_values(robot, values)


def _cut_short(view: RunView) -> str | None:
    first_s, last_s = view.covered_s
    share = max(last_s - max(first_s, 0), 0) / view.drive_s
    if share < LEAST_COVERED:
        return f"its track covers {100 * share:.0f} % of {view.drive_s:.1f} s of driving"
    return None


def _check_same_clock(recording: Recording) -> None:
    ahead_s = recording.tracker_ahead_s
    if ahead_s is None or abs(ahead_s) > SAME_CLOCK_S:
        found = "unknown" if ahead_s is None else f"{ahead_s:.1f} s"
        raise ConfigurationError(
            f"--same-clock: the tracker's clock is ahead of the robot's by {found}, expected less "
            f"than {SAME_CLOCK_S} s; leave the option away"
        )


def _named(name: str, index: int, recordings: Sequence[Recording]) -> str:
    return name if len(recordings) == 1 else f"recording {index + 1}, {name}"
