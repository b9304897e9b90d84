"""From recordings to a robot: fit half of the repetitions, try it on the other half."""

from collections.abc import Callable, Sequence

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.identification.conclusions import estimates, latency
from mbot_workstation.identification.estimate import Identification
from mbot_workstation.identification.extras import ALL_ROUNDS, EXTRAS, look_for_extras
from mbot_workstation.identification.friction import (
    DRY_NAME,
    FAR_ROUNDS,
    GRIP_NAME,
    ROUNDS,
    WIDE_ROUNDS,
    FrictionFinding,
    look_for_friction,
)
from mbot_workstation.identification.held_out import errors, is_held_out, repeatability
from mbot_workstation.identification.mixed_fit import MixedFit, begin
from mbot_workstation.identification.parameters import NAMES, value, with_values
from mbot_workstation.identification.preparation import Prepared, prepare
from mbot_workstation.identification.run_view import RunView
from mbot_workstation.identification.scatter import Scatter, usual_scatter
from mbot_workstation.identification.selection import Selection, select
from mbot_workstation.identification.stray_runs import stray_runs
from mbot_workstation.recordings.run import Recording
from mbot_workstation.simulation.robot_parameters import RobotParameters

SMALL = 2
"""Repetitions of each manoeuvre on which it is decided what to fit."""

SMALL_ROUNDS, FULL_ROUNDS = 12, 12

Advance = Callable[[float], None]
"""Called with the share of the work that is done."""


def identify(
    recordings: Sequence[Recording],
    nominal: RobotParameters,
    *,
    robot_id: str,
    same_clock: bool = False,
    advance: Advance | None = None,
) -> Identification:
    """Identify one robot.

    Args:
        recordings: of this robot, all with the same tracker or not.
        nominal: what is known of it: body and camera calibrated or not, motors nominal.
        robot_id: whose.
        same_clock: the trackers' times are the robot's clock. Then the delay from command to
            wheel can be told, the tracker's own delay included.
        advance: progress.

    Raises:
        ConfigurationError: the recordings can't be fitted; the text says why.

    """
    prepared = prepare(recordings, nominal, same_clock=same_clock)
    fitted, held = _split(prepared.views)
    bar = _Bar(advance, small=len(_small(fitted)), full=len(fitted))
    small, selection, finding = _choose(_small(fitted), prepared, nominal, bar)
    left_out = dict(prepared.left_out)
    fit = _full(fitted, prepared, nominal, small, selection, bar)
    stray = stray_runs(fit, held)
    if stray:
        views = [*fitted, *held]
        left_out |= {_name(views[index], recordings): why for index, why in stray.items()}
        fitted, held = (
            [view for index, view in enumerate(views) if index not in stray and index in part]
            for part in (range(len(fitted)), range(len(fitted), len(views)))
        )
        _check_enough(fitted, held, left_out)
        fit = _full(fitted, prepared, nominal, small, selection, bar)
    # From here on, what the model gets wrong in a manoeuvre counts as scatter.
    here = fit.judge(selection.names)
    bar.end()
    settings = fit.state.settings
    return Identification(
        robot_id,
        nominal,
        fit.state.robot,
        estimates(fit, here, nominal, selection, finding),
        latency(fit, here, prepared, same_clock=same_clock),
        tuple(float(setting[1]) for setting in settings),
        tuple((float(s[2]), float(s[3]), float(s[4])) for s in settings),
        selection.singular_values,
        fit.scatter,
        errors(held, settings, nominal, fit.state.robot),
        repeatability([*fitted, *held], settings),
        len(fitted),
        left_out,
    )


class _Bar:
    """Work done, counted in runs a round; a fit that settles early leaves some undone."""

    def __init__(self, advance: Advance | None, small: int, full: int) -> None:
        self._advance, self._done = advance, 0.0
        extras = 2 * ALL_ROUNDS
        friction = 4 * WIDE_ROUNDS + 5 * ROUNDS + 2 * FAR_ROUNDS
        self._all = small * (SMALL_ROUNDS + extras + friction) + full * FULL_ROUNDS

    def count(self, runs: int) -> None:
        self._done += runs
        if self._advance is not None:
            self._advance(min(self._done / self._all, 0.99))

    def end(self) -> None:
        if self._advance is not None:
            self._advance(1.0)


def _split(views: Sequence[RunView]) -> tuple[list[RunView], list[RunView]]:
    away = is_held_out(views)
    fitted = [view for view, out in zip(views, away, strict=True) if not out]
    held = [view for view, out in zip(views, away, strict=True) if out]
    _check_enough(fitted, held, {})
    return fitted, held


def _check_enough(
    fitted: Sequence[RunView], held: Sequence[RunView], left_out: dict[str, str]
) -> None:
    if fitted and held:
        return
    without = f" without the {len(left_out)} that can't be used" if left_out else ""
    raise ConfigurationError(
        f"{len(fitted) + len(held)} runs{without}, and no manoeuvre twice: half of the repetitions "
        "is held out to judge the result; drive each manoeuvre at least twice"
    )


def _small(views: Sequence[RunView]) -> list[RunView]:
    """A few repetitions of each manoeuvre."""
    counts: dict[str, int] = {}
    result: list[RunView] = []
    for view in views:
        name = view.flat.run.maneuver
        counts[name] = counts.get(name, 0) + 1
        if counts[name] <= SMALL:
            result.append(view)
    return result


def _choose(
    views: Sequence[RunView], prepared: Prepared, nominal: RobotParameters, bar: _Bar
) -> tuple[MixedFit, Selection, FrictionFinding]:
    """Decide on a few runs what can be fitted, and fit it there."""
    fit = MixedFit(
        views,
        prepared.fixed,
        begin(views, prepared.robot, prepared.fixed.guess),
        usual_scatter(),
    )
    later = {DRY_NAME, GRIP_NAME, *EXTRAS}
    smooth = [name for name in NAMES if name not in later]
    names = select(fit.linearise(smooth), smooth).names
    if not names:
        raise ConfigurationError(
            "the recordings tell nothing about the robot: is it driving in them, for some seconds?"
        )

    def progress() -> None:
        bar.count(len(views))

    fit.scatter = Scatter()  # wide, so that nothing far away pulls too hard
    fit.run(names, SMALL_ROUNDS, progress)
    extras = look_for_extras(fit, names, progress)
    names = (*names, *extras)
    finding = look_for_friction(fit, names, progress)
    slip = (GRIP_NAME,) if finding.slips else ()
    wanted = [name for name in NAMES if name not in later or name in (*extras, *slip)]
    scatter = fit.scatter
    moved = {name: value(fit.state.robot, name) - value(nominal, name) for name in names}
    selection = select(fit.judge(wanted), wanted, moved)
    fit.scatter = scatter
    return fit, selection, finding


def _full(
    views: Sequence[RunView],
    prepared: Prepared,
    nominal: RobotParameters,
    small: MixedFit,
    selection: Selection,
    bar: _Bar,
) -> MixedFit:
    # What was guessed or tried on the way but can't be told goes back to what it was.
    robot = small.state.robot
    kept = {*selection.names, DRY_NAME, GRIP_NAME}
    back = {name: value(nominal, name) for name in NAMES if name not in kept}
    robot = with_values(robot, back)
    start = begin(views, robot, small.state.settings)
    fit = MixedFit(views, prepared.fixed, start, small.scatter)
    fit.run(selection.names, FULL_ROUNDS, lambda: bar.count(len(views)))
    return fit


def _name(view: RunView, recordings: Sequence[Recording]) -> str:
    name = view.flat.name
    return name if len(recordings) == 1 else f"recording {view.flat.recording + 1}, {name}"
