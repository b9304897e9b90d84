"""Drive a robot: who is alive, let it run, stop it, watch it, drive it by hand."""

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from mbot_protocol.errors import (
    ARMED_BUT_STANDING,
    ConfigurationError,
    InterruptedByUserError,
    RefusedError,
    UnreachableError,
)
from mbot_workstation.cli.common_options import (
    CertificateOptions,
    LinkOptions,
    json_option,
    robots_option,
)
from mbot_workstation.cli.options import argument, option, output_file, with_options
from mbot_workstation.cli.presenter import Answer, table
from mbot_workstation.wording import (
    fault_lines,
    one_line,
    short_digest,
    stop_words,
    typed,
    waiting_words,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import RenderableType
    from rich.table import Table

    from mbot_workstation.fleet.link.fleet import RobotReport


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotsOptions(CertificateOptions):
    """What `robots` takes."""

    robot: list[str] | None = robots_option()
    as_json: bool = json_option()


@with_options
def robots(options: RobotsOptions) -> Answer:
    """List the robots that are alive, and how they are doing: all enrolled ones, or those named.

    Exit code 4 if an address or a robot did not answer.

    Example: `workstation robots --robot mbot-1 --robot 10.0.0.7`
    """
    from mbot_workstation.fleet.enrolment.enrolled_robots import find_destinations
    from mbot_workstation.fleet.link.fleet import look_around

    reports = look_around(find_destinations(options.robot or [], options.security()))
    missed = any(report.error for report in reports)
    return Answer(reports, _seen(reports), exit_code=UnreachableError.exit_code if missed else 0)


def _seen(reports: "Sequence[RobotReport]") -> "Iterator[RenderableType]":
    alive = [report for report in reports if not report.error]
    if alive:
        yield _alive_table(alive)
    for report in reports:
        for line in fault_lines(report.faults):
            yield f"{report.robot_id}: {line}"
        for line in fault_lines(report.notices):
            yield f"{report.robot_id}: note: {line}"
        if report.error:
            print(f"workstation: {report.error}", file=sys.stderr)


def _alive_table(reports: "Sequence[RobotReport]") -> "Table":
    rows: list[tuple[str, ...]] = []
    for one in reports:
        guard = "" if one.board_has_deadman or not one.board_version else " (no dead-man)"
        model = f"{one_line(one.model_name or '')} {short_digest(one.model_sha256 or '')}"
        rows.append(
            (
                one.robot_id or "",
                one.address,
                f"{one.state}{' (the hand let go)' if one.hand_let_go else ''}",
                model.strip(),
                f"{one.decision_rate_hz} Hz",
                str(one.missed_ticks),
                one_line(one.board_version or "not connected") + guard,
                one_line(one.release or f"none ({one.software_version})"),
            )
        )
    headings = ("robot", "address", "state", "model", "rate", "missed", "board", "release")
    return table(headings, rows)


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions(LinkOptions):
    """What `run` takes."""

    when_ready: bool = option(
        False, "Also if it cannot drive yet: begin as soon as it can.", "--when-ready"
    )
    as_json: bool = json_option()


@dataclass(frozen=True, slots=True)
class FaultFound:
    """What keeps a robot from driving."""

    kind: str
    detail: str


@dataclass(frozen=True, slots=True)
class RunOutcome:
    """The state of a robot that was told to run; "fault" if it is armed and waits."""

    robot_id: str
    state: str
    faults: list[FaultFound]


@with_options
def run(options: RunOptions) -> Answer:
    """Let the robot's active model drive. With a fault in the way it refuses and says which.

    Exit code 0 means that it drives; 7 that it is armed but waits for a fault to be mended.

    Examples: `workstation run --robot mbot-1.local`, `workstation run --when-ready`
    """
    from mbot_protocol.beat.fields import state_word
    from mbot_workstation.fleet.link.remote_control import RemoteControl

    with options.link() as link:
        control, robot_id = RemoteControl(link), link.robot_id
        state = control.run(when_ready=options.when_ready)
        if state != "fault":
            return Answer(RunOutcome(robot_id, state, []), [f"{robot_id}: {state}"])
        status = control.after_run()
    state = state_word(status.state)
    if state == "stopped":
        raise RefusedError(f"robot {robot_id}: {stop_words(status)}; look, then run again")
    waits = state == "fault"
    words = f"armed; {waiting_words(status.faults)}" if waits else state
    return Answer(
        RunOutcome(robot_id, state, [FaultFound(one.kind, one.detail) for one in status.faults]),
        [f"{robot_id}: {words}"],
        exit_code=ARMED_BUT_STANDING if waits else 0,
    )


@with_options
def stop(options: LinkOptions) -> None:
    """Stop the robot. Exit code 0 means that its board has confirmed that the wheels have stopped.

    Example: `workstation stop --robot mbot-1.local`
    """
    from mbot_workstation.fleet.link.remote_control import RemoteControl

    with options.link() as link:
        print(f"{link.robot_id}: {RemoteControl(link).stop()}")


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkOptions(LinkOptions):
    """What `mark` takes."""

    back_s: float = option(
        3.0, "From so long ago until now.", "--back", metavar="SECONDS", min=0.1, max=10
    )


@with_options
def mark(options: MarkOptions) -> None:
    """Note in the robot's recording that what it has just done was wrong. It drives on.

    Example: `workstation mark --robot mbot-1.local`
    """
    from mbot_workstation.fleet.link.remote_control import RemoteControl

    with options.link() as link:
        RemoteControl(link).mark(options.back_s)
        print(f"{link.robot_id}: marked: the {options.back_s:g} s until now were wrong")


@dataclass(frozen=True, slots=True, kw_only=True)
class ConsoleOptions(LinkOptions):
    """What `console` takes."""

    named: str = argument("As --robot.", default="", metavar="[ROBOT]")
    port: int = option(
        8700,
        "Of the page, on this machine only; 0: any free one.",
        metavar="PORT",
        min=0,
        max=65535,
    )
    browser: bool = option(True, "Open the browser, or only say where.", "--open/--no-open")


@with_options
def console(options: ConsoleOptions) -> None:
    """Serve a page in the browser: live pictures, state in words, STOP, run, driving by hand.

    On this machine only, and only for who has the address that it prints. Needs the extra:
    `pip install -e '.[console]'`. Ctrl-C ends.

    Example: `workstation console mbot-1.local`
    """
    if options.named and options.robot not in ("", options.named):
        raise ConfigurationError(
            f"ROBOT is {options.named} and --robot is {options.robot}: give one of them"
        )
    try:
        from mbot_workstation.look.console.console_app import Console
        from mbot_workstation.look.console.console_server import LOOPBACK, listen, serve
    except ModuleNotFoundError as error:
        raise ConfigurationError(
            f"console needs {error.name}: pip install -c constraints.txt -e '.[console]' in the "
            "checkout"
        ) from None
    from mbot_workstation.look.console.door import Door, new_token

    token = new_token()
    wanted = replace(options, robot=options.named or options.robot)
    with listen(options.port) as listener, wanted.link() as link:
        page = f"http://{LOOPBACK}:{listener.getsockname()[1]}/{token}/"

        def ready() -> None:
            import webbrowser

            print(f"{link.robot_id}: {page}", flush=True)
            if options.browser:
                webbrowser.open(page)

        with Console(link, Door(token)) as served:
            serve(served.app, listener, ready)


@dataclass(frozen=True, slots=True, kw_only=True)
class TelemetryOptions(LinkOptions):
    """What `telemetry` takes."""

    record: Path | None = output_file(
        None, "Also record into a new MCAP file.", "--record", metavar="FILE.mcap"
    )
    seconds: float | None = option(
        None, "End by itself after N seconds.", "--seconds", metavar="N", min=0.1
    )
    as_json: bool = json_option()


@with_options
def telemetry(options: TelemetryOptions) -> None:
    """Watch a robot's decisions live, and record them.

    In a terminal a view that redraws itself; in a pipe a line every two seconds; with --json one
    object a decision, stage times in ms after the tick's start. Ctrl-C ends and closes the
    recording.

    Example: `workstation telemetry --robot mbot-1.local --record drive.mcap`
    """
    from mbot_workstation.fleet.telemetry.output import output_for
    from mbot_workstation.fleet.telemetry.watch import watch

    count = 0
    try:
        with options.link() as link:
            output = output_for(link.robot_id, as_json=options.as_json)
            for decisions in watch(link, output, options.record, options.seconds):
                count = decisions
    except KeyboardInterrupt:
        if options.record is None:
            raise
        raise InterruptedByUserError(_recorded(count, options.record)) from None
    if options.record is not None:
        print(f"workstation: {_recorded(count, options.record)}", file=sys.stderr)


def _recorded(count: int, path: Path) -> str:
    return (
        f"recorded {count} decisions into {path}; open it in Foxglove, Lichtblick or Rerun, or: "
        f"workstation explain POLICY.onnx --recording {typed(path)}"
    )


_HAND = "While a key or a button is held"


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveOptions(LinkOptions):
    """What `drive` takes."""

    left: float | None = argument("Left wheel; 1 is full forward.", default=None, min=-1, max=1)
    right: float | None = argument("Right wheel, likewise.", default=None, min=-1, max=1)
    seconds: float = option(
        1.0, "How long.", "--for", "--seconds", metavar="SECONDS", min=0.1, max=600
    )
    keyboard: bool = option(
        False,
        "W A S D or arrows: held keys drive. Space: STOP, R: the policy runs, M: this was wrong, "
        "Q: end.",
        "--keyboard",
        panel=_HAND,
    )
    gamepad: bool = option(
        False,
        "Right shoulder button held: left stick drives. B (east): STOP, start: the policy runs, X "
        "(west): this was wrong.",
        "--gamepad",
        panel=_HAND,
    )
    device: str = option(
        "", "Of the gamepad; the first one if not given.", "--device", panel=_HAND, metavar="PATH"
    )
    speed: float = option(0.4, "With --keyboard, up to 1.", "--speed", panel=_HAND, min=0.1, max=1)


@with_options
def drive(options: DriveOptions) -> None:
    """Drive by hand: for some seconds, or while a key or a gamepad's button is held.

    The command is sent again and again and holds for half a second at most, so the robot also stops
    when this machine or the link dies. Ctrl-C stops at once.

    Examples: `workstation drive 0.4 -0.4 --for 2`, `workstation drive --gamepad`
    """
    from mbot_workstation.fleet.by_hand.timed_drive import drive_for
    from mbot_workstation.fleet.link.remote_control import RemoteControl

    given = [wheel is not None for wheel in (options.left, options.right)]
    if given[0] != given[1] or sum((given[0], options.keyboard, options.gamepad)) != 1:
        raise ConfigurationError("expected one of: LEFT RIGHT, --keyboard, --gamepad")
    if options.left is None or options.right is None:
        _by_hand(options)
        return
    with options.link() as link:
        state = drive_for(RemoteControl(link), options.left, options.right, options.seconds)
        print(f"{link.robot_id}: {state}")


def _by_hand(options: DriveOptions) -> None:
    from contextlib import ExitStack

    from mbot_workstation.fleet.by_hand.gamepad import open_gamepad
    from mbot_workstation.fleet.by_hand.hand_session import HandSession
    from mbot_workstation.fleet.by_hand.terminal_keys import TerminalKeys

    with ExitStack() as stack:
        if options.gamepad:
            device, name = open_gamepad(options.device)
            how = f"{name}: hold the right shoulder button; B stops, start lets the policy run"
            how += ", X says that the last 3 s were wrong"
        else:
            device = stack.enter_context(TerminalKeys(options.speed))
            how = "hold W A S D or arrows; space stops, R lets the policy run"
            how += ", M says that the last 3 s were wrong, Q ends"
        link = stack.enter_context(options.link())
        session = HandSession(link, lambda words: print(f"{link.robot_id}: {words}", flush=True))
        with session:
            print(f"{link.robot_id}: {how}", flush=True)
            session.follow(device)
