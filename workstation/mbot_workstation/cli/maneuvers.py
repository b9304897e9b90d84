"""`workstation maneuvers`: drive the paper's eight maneuvers and record what was told."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.common_options import LinkOptions, json_option
from mbot_workstation.cli.options import option, output_folder, with_options
from mbot_workstation.cli.presenter import Answer, table
from mbot_workstation.measure.maneuvers.plan import (
    Order,
    Planned,
    announcement,
    plan,
    room_needed_m,
)
from mbot_workstation.measure.tracks.maneuver import (
    MANEUVER_S,
    MANEUVERS,
    REPETITIONS,
    SLOW,
    maneuver_named,
)
from mbot_workstation.wording import typed

if TYPE_CHECKING:
    from mbot_workstation.fleet.link.robot_link import RobotLink
    from mbot_workstation.measure.maneuvers.maneuver_session import SessionSettings
    from mbot_workstation.measure.maneuvers.session_journal import Journal

app = typer.Typer(
    help="Drive the paper's eight maneuvers, to learn how a robot moves.", no_args_is_help=True
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ListManeuversOptions:
    """What `list_maneuvers` takes."""

    seconds: float = option(MANEUVER_S, "Of each maneuver; the paper has 10.", min=0.3, max=120)
    as_json: bool = json_option()


@dataclass(frozen=True, slots=True)
class ListedManeuver:
    """A maneuver, its wheel commands in [-1, 1], and the free floor it needs."""

    name: str
    left: float
    right: float
    length_m: float
    width_m: float


@app.command("list")
@with_options
def list_maneuvers(options: ListManeuversOptions) -> Answer:
    """Show the maneuvers and the free floor each needs.

    Example: `workstation maneuvers list --seconds 5`
    """
    found = [
        ListedManeuver(
            one.name,
            one.left,
            one.right,
            *(round(side_m, 2) for side_m in room_needed_m(one, options.seconds)),
        )
        for one in (*MANEUVERS, SLOW)
    ]
    rows = [
        (m.name, f"{m.left:+g}", f"{m.right:+g}", f"{m.length_m:.1f} x {m.width_m:.1f}")
        for m in found
    ]
    return Answer(found, [table(("maneuver", "left", "right", "free floor, m"), rows)])


@dataclass(frozen=True, slots=True, kw_only=True)
class RunManeuversOptions(LinkOptions):
    """What `run` takes."""

    output: Path | None = output_folder(
        None, "New recording; recordings/ROBOT-DATE if not given.", metavar="FOLDER"
    )
    resume: Path | None = option(
        None, "Go on with a recording: only what is missing.", metavar="FOLDER"
    )
    seconds: float = option(MANEUVER_S, "Of each maneuver; the paper has 10.", min=0.3, max=120)
    repetitions: int = option(REPETITIONS, "Of every maneuver; the paper has 10.", min=1, max=100)
    maneuver: list[str] | None = option(
        None, "Only this one; may be given several times.", metavar="NAME"
    )
    order: Order = option(
        Order.PAIRED,
        "Of each round: each followed by its opposite, so that the robot comes back; as "
        "listed; or shuffled.",
    )
    seed: int = option(0, "Of the shuffling.")
    pause: float = option(5.0, "Countdown before each run.", metavar="SECONDS", min=0, max=600)
    calibration: Path | None = option(
        None,
        "The calibration that the robot's daemon uses, if it uses one: its trims are "
        "noted in the recording.",
        metavar="FOLDER",
    )
    telemetry: bool = option(True, "Record all the robot publishes.", "--telemetry/--no-telemetry")
    yes: bool = option(False, "Ask nothing and run through; for scripts.", "--yes")


@app.command("run")
@with_options
def run(options: RunManeuversOptions) -> None:
    """Drive every maneuver, and record commands and telemetry on the robot's clock.

    Start the tracker first (`workstation track`, or any other), and keep it running to the end.
    The robot stands still for a second or more before and after each run. Keys: p or Enter
    pauses, r forgets the last run and drives it again, q quits; while it drives any key stops it.
    What was recorded is kept, whatever happens; --resume goes on.

    Examples:

    - `workstation maneuvers run --robot mbot-1.local`
    - `workstation maneuvers run --seconds 5 --repetitions 4 --order shuffled`
    - `workstation maneuvers run --maneuver forward-forward --repetitions 3`
    - `workstation maneuvers run --maneuver slow --repetitions 3`: tells the motors' dead bands
    - `workstation maneuvers run --resume recordings/mbot-1-2026-11-21`
    """
    import time

    from mbot_protocol.drive.actions import WheelMaps
    from mbot_workstation.measure.maneuvers.maneuver_drive import measure_robot_time
    from mbot_workstation.measure.maneuvers.maneuver_session import SessionSettings, check_ready
    from mbot_workstation.measure.maneuvers.session_journal import Journal
    from mbot_workstation.sim.calibrated.motion_calibration import read_motion

    if options.output is not None and options.resume is not None:
        raise ConfigurationError("--output and --resume exclude each other")
    if options.repetitions < 2:
        raise ConfigurationError(
            f"--repetitions is {options.repetitions}, expected 2 or more: `workstation identify` "
            "holds half of every maneuver's runs out to judge its result"
        )
    chosen = (
        [maneuver_named(name) for name in options.maneuver] if options.maneuver else list(MANEUVERS)
    )
    planned = plan(chosen, options.repetitions, options.order, options.seed)
    motion = read_motion(options.calibration) if options.calibration else None
    attended = sys.stdin.isatty() and not options.yes
    if not attended and not options.yes:
        raise ConfigurationError("nobody can be asked here: --yes says that the robot may drive")
    with options.link() as link:
        check_ready(link)
        robot_time = measure_robot_time(link)
        began_unix_s = round(time.time() - robot_time.robot_s(time.monotonic_ns()), 3)
        today = time.strftime("%Y-%m-%d")
        if options.resume is not None:
            journal = Journal.resume(options.resume, link.robot_id, began_unix_s)
        else:
            journal = Journal.create(
                options.output or Path("recordings") / f"{link.robot_id}-{today}",
                link.robot_id,
                motion.wheel_maps() if motion else WheelMaps(),
                today,
                began_unix_s,
            )
        settings = SessionSettings(options.seconds, options.pause, attended)
        left = [p for p in planned if (p.maneuver.name, p.repetition) not in journal.recorded]
        print(announcement(left, options.seconds, options.pause))
        if left and (options.yes or _may_drive()):
            _drive(link, journal, planned, settings, telemetry=options.telemetry)


def _may_drive() -> bool:
    return typer.confirm("Is the floor free, the tracker running, and may the robot drive?")


def _drive(
    link: "RobotLink",
    journal: "Journal",
    planned: tuple[Planned, ...],
    settings: "SessionSettings",
    *,
    telemetry: bool,
) -> None:
    from contextlib import ExitStack

    from rich.console import Console

    from mbot_workstation.measure.maneuvers.maneuver_session import Session
    from mbot_workstation.measure.maneuvers.telemetry_recorder import TelemetryRecorder
    from mbot_workstation.measure.maneuvers.terminal import (
        Keyboard,
        NoKeys,
        PlainDisplay,
        TerminalDisplay,
    )

    before = len(journal.runs)
    recorder = TelemetryRecorder(link, journal.telemetry_path()) if telemetry else None
    whole = False
    try:
        with ExitStack() as stack:
            if recorder is not None:
                stack.enter_context(recorder)
            keys = stack.enter_context(Keyboard()) if settings.attended else NoKeys()
            console = Console()
            shown = settings.attended and console.is_terminal
            display = stack.enter_context(TerminalDisplay(console)) if shown else PlainDisplay()
            whole = Session(link, journal, planned, settings, keys, display).run()
    finally:
        if recorder is not None and recorder.failure:
            print(f"workstation: note: telemetry ends early: {recorder.failure}", file=sys.stderr)
        print(
            f"{len(journal.runs)} runs are in {journal.folder}, {len(journal.runs) - before} of "
            "them new" + ("" if whole else f"; go on by --resume {typed(journal.folder)}")
        )
    if whole:
        print(
            f"now put the track there: track.csv, .tum or .mcap, see docs/recordings.md; then "
            f"`workstation identify {typed(journal.folder)}`"
        )
