"""From recordings to runs that can be fitted: clocks guessed, unusable runs found and named."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mbot_protocol.drive.actions import WheelMaps
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.identification.exclusion import Exclusion, Fault
from mbot_workstation.measure.identification.floor import flatten
from mbot_workstation.measure.identification.initial_guess import (
    KinematicGuess,
    clocks,
    gain_of,
    kinematic_guess,
)
from mbot_workstation.measure.identification.observed_run import ObservedRun, observe
from mbot_workstation.measure.identification.prediction import SETTING, Noise
from mbot_workstation.measure.identification.rollout import plans_of
from mbot_workstation.measure.identification.solver import Problem
from mbot_workstation.measure.tracks.run import ManeuverRecording
from mbot_workstation.measure.tracks.track import Array
from mbot_workstation.sim.body.robot_parameters import RobotParameters

LEAST_COVERED = 0.85
"""Of a run's driving that its track must cover."""

SAME_CLOCK_S = 0.5
"""Clocks said to be one may differ by what the wheels and the tracker take, not by more."""

PLACE_WALK, HEADING_WALK = 0.002, 0.01
"""What a robot does by chance, per root of a second [m, rad]: until the runs have told."""


@dataclass(frozen=True, slots=True, eq=False)
class Dataset:
    """Runs of all recordings.

    Attributes:
        runs: those that can be used.
        robot: as far as it is known.
        guessed: parameters by plain kinematics.
        settings: first guess of each recording's, shape (recordings, 6).
        free: which of them may move, same shape.
        wheel_maps: of each recording.
        excluded: why runs are not among them, by their names.

    """

    runs: tuple[ObservedRun, ...]
    robot: RobotParameters
    guessed: Mapping[str, float]
    settings: Array
    free: Array
    wheel_maps: tuple[WheelMaps, ...]
    excluded: dict[str, Exclusion]

    def problem(self, chosen: Sequence[int], names: Sequence[str]) -> Problem:
        """The fit of some runs for some parameters."""
        runs = tuple(self.runs[index] for index in chosen)
        plans, which = plans_of(
            [(run.flat.run.commands, self.wheel_maps[run.flat.recording]) for run in runs]
        )
        return Problem(
            runs, tuple(plans), tuple(which), self.robot, self.settings, self.free, tuple(names)
        )

    def noise(self) -> list[Noise]:
        """Of each recording, as far as its tracks show it by themselves."""
        result: list[Noise] = []
        for recording in range(len(self.settings)):
            mine = [run.flat for run in self.runs if run.flat.recording == recording]
            place_m = float(np.median([flat.place_noise_m for flat in mine])) if mine else 0.004
            heading = float(np.median([f.heading_noise_rad for f in mine])) if mine else 0.005
            result.append(Noise(max(place_m, 1e-4), max(heading, 1e-4), PLACE_WALK, HEADING_WALK))
        return result

    def without(self, excluded: Mapping[int, Exclusion]) -> "Dataset":
        """The same without these runs, by index."""
        kept = tuple(run for index, run in enumerate(self.runs) if index not in excluded)
        return replace(self, runs=kept, excluded=self.excluded | self.by_name(excluded))

    def by_name(self, excluded: Mapping[int, Exclusion]) -> dict[str, Exclusion]:
        """Runs by their names instead of by index."""
        return {self.named(self.runs[index]): why for index, why in excluded.items()}

    def named(self, run: ObservedRun) -> str:
        """How messages call a run."""
        return _named(run.flat.name, run.flat.recording, len(self.settings))


def prepare(
    recordings: Sequence[ManeuverRecording], robot: RobotParameters, *, same_clock: bool = False
) -> Dataset:
    """Look at all recordings of one robot.

    Args:
        recordings: at least one.
        robot: as far as it is known.
        same_clock: the trackers' times are the robot's clock.

    Raises:
        ConfigurationError: nothing can be fitted, and why.

    """
    runs: list[ObservedRun] = []
    guesses: list[KinematicGuess] = []
    excluded: dict[str, Exclusion] = {}
    settings = np.zeros((len(recordings), len(SETTING)))
    free = np.ones((len(recordings), len(SETTING)))
    for index, recording in enumerate(recordings):
        if same_clock:
            _check_same_clock(recording)
        usable, unusable = _observed(recording, index)
        guess = kinematic_guess(usable, robot, recording.wheel_maps)
        for number in guess.excluded:
            unusable[usable[number].flat.name] = guess.excluded[number]
        runs += [run for number, run in enumerate(usable) if number not in guess.excluded]
        guesses.append(guess)
        excluded |= {_named(n, index, len(recordings)): why for n, why in unusable.items()}
        tracker = guess.tracker
        settings[index, 2:5] = tracker.real, tracker.imag, guess.tracker_yaw_rad
        own_clock = recording.tracker_ahead_s is None
        free[index, 0], free[index, 1] = not own_clock, not own_clock and not same_clock
    if not runs:
        name, why = next(iter(excluded.items()))
        raise ConfigurationError(f"none of the {len(excluded)} runs can be used; {name}: {why.why}")
    maps = tuple(recording.wheel_maps for recording in recordings)
    return Dataset(tuple(runs), robot, _guessed(guesses, robot), settings, free, maps, excluded)


def _observed(
    recording: ManeuverRecording, index: int
) -> tuple[list[ObservedRun], dict[str, Exclusion]]:
    flat = flatten(recording, index)
    own_clock = recording.tracker_ahead_s is None
    begins_s = np.array([run.run.commands.start_s for run in flat])
    names = np.array([run.run.maneuver for run in flat])
    ahead_s, unclocked = clocks(flat, recording.tracker_ahead_s)
    usable: list[ObservedRun] = []
    unusable: dict[str, Exclusion] = {}
    for number, run in enumerate(flat):
        mine = begins_s[names == run.run.maneuver]
        middles_s = float(begins_s.mean()), float(mine.mean())
        seen = observe(run, float(ahead_s[number]), middles_s, own_clock=own_clock)
        why = unclocked.get(number) or _cut_short(seen)
        if why is None:
            usable.append(seen)
        else:
            unusable[run.name] = why
    if not usable:
        name, why = next(iter(unusable.items()))
        raise ConfigurationError(f"none of the {len(flat)} runs can be used; {name}: {why.why}")
    return usable, unusable


def _cut_short(run: ObservedRun) -> Exclusion | None:
    share = run.covered_s / run.drive_s
    if share >= LEAST_COVERED and run.seen.shape[1] > 1:
        return None
    why = f"its track covers {max(share, 0):.0%} of the {run.drive_s:.1f} s that it drove"
    return Exclusion(Fault.SHORT_TRACK, why)


def _check_same_clock(recording: ManeuverRecording) -> None:
    ahead_s = recording.tracker_ahead_s
    if ahead_s is None or abs(ahead_s) > SAME_CLOCK_S:
        found = "unknown" if ahead_s is None else f"{ahead_s:.1f} s"
        raise ConfigurationError(
            f"--same-clock: the tracker's clock is ahead of the robot's by {found}, expected less "
            f"than {SAME_CLOCK_S} s; leave the option away"
        )


def _guessed(guesses: Sequence[KinematicGuess], robot: RobotParameters) -> dict[str, float]:
    """The mean of what the recordings say."""
    result: dict[str, float] = {}
    for side in ("left", "right"):
        speeds = [getattr(guess, f"{side}_m_s") for guess in guesses]
        known = [speed for speed in speeds if speed is not None]
        if known:
            result[f"{side}_gain"] = gain_of(float(np.mean(known)), robot)
    tracks = [guess.track_m for guess in guesses if guess.track_m is not None]
    if tracks:
        result["track_m"] = float(np.mean(tracks))
    return result


def _named(name: str, recording: int, recordings: int) -> str:
    return name if recordings == 1 else f"recording {recording + 1}, {name}"
