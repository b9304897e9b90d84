"""`workstation run`, `stop` and `drive`: command a robot."""

from dataclasses import dataclass

from mbot_workstation.cli.link_options import LinkOptions, json_option
from mbot_workstation.cli.options import argument, option, with_options

RESEND_S = 0.2
HOLD_MS = 500
"""Two commands in a row may be lost before the robot stops between them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions(LinkOptions):
    """What `run` takes."""

    when_ready: bool = option(
        False, "Also if it cannot drive yet: begin as soon as it can.", "--when-ready"
    )
    as_json: bool = json_option()


@with_options
def run(options: RunOptions) -> None:
    """Let the robot's active model drive. With a fault in the way it refuses and says which.

    Exit code 0 means that it drives; 7 that it is armed and a fault keeps it standing until that is
    mended.

    Examples: `workstation run --robot mbot-1.local`, `workstation run --when-ready`
    """
    import json

    import typer

    from mbot_protocol.beat.fields import state_word
    from mbot_protocol.errors import ARMED_BUT_STANDING, RefusedError
    from mbot_protocol.v1.messages_pb2 import Fault
    from mbot_workstation.fleet.link.remote_control import RemoteControl
    from mbot_workstation.wording import stop_words, waiting_words

    faults: list[Fault] = []
    with options.link() as link:
        control = RemoteControl(link)
        state = control.run(when_ready=options.when_ready)
        if state == "fault":
            status = control.after_run()
            state, faults = state_word(status.state), list(status.faults)
            if state == "stopped":
                words = f"{stop_words(status)}; look, then run again"
                raise RefusedError(f"robot {link.robot_id}: {words}")
        robot_id = link.robot_id
    if options.as_json:
        found = [{"kind": fault.kind, "detail": fault.detail} for fault in faults]
        print(json.dumps({"robot_id": robot_id, "state": state, "faults": found}))
    else:
        words = f"armed; {waiting_words(faults)}" if state == "fault" else state
        print(f"{robot_id}: {words}")
    if state == "fault":
        raise typer.Exit(ARMED_BUT_STANDING)


@with_options
def stop(options: LinkOptions) -> None:
    """Stop the robot. Exit code 0 means that its board has confirmed that it stands.

    Example: `workstation stop --robot mbot-1.local`
    """
    from mbot_workstation.fleet.link.remote_control import RemoteControl

    with options.link() as link:
        print(f"{link.robot_id}: {RemoteControl(link).stop()}")


_HAND = "While a key or a button is held"


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveOptions(LinkOptions):
    """What `drive` takes."""

    left: float | None = argument("Left wheel; 1 is full forward.", default=None, min=-1, max=1)
    right: float | None = argument("Right wheel, likewise.", default=None, min=-1, max=1)
    seconds: float = option(1.0, "How long.", "--for", metavar="SECONDS", min=0.1, max=600)
    keyboard: bool = option(
        False,
        "W A S D or arrows: held keys drive. Space: STOP, R: the policy runs, Q: end.",
        "--keyboard",
        panel=_HAND,
    )
    gamepad: bool = option(
        False,
        "Right shoulder button held: left stick drives. B (east): STOP, start: the policy runs.",
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
    from mbot_protocol.errors import ConfigurationError

    ways = [
        options.left is not None and options.right is not None,
        options.keyboard,
        options.gamepad,
    ]
    if sum(ways) != 1 or (options.left is None) != (options.right is None):
        raise ConfigurationError("expected one of: LEFT RIGHT, --keyboard, --gamepad")
    if options.left is None or options.right is None:
        _by_hand(options)
    else:
        _for_seconds(options, options.left, options.right)


def _for_seconds(options: DriveOptions, left: float, right: float) -> None:
    import math
    import time

    from mbot_protocol.errors import ConfigurationError
    from mbot_workstation.fleet.link.remote_control import RemoteControl

    if not (math.isfinite(left) and math.isfinite(right)):
        raise ConfigurationError(f"wheels are {left}, {right}, expected numbers in [-1, 1]")
    with options.link() as link:
        control = RemoteControl(link)
        control.synchronise()  # before anything moves: the first command must not come late
        began_s, holds_until_s = time.monotonic(), 0.0
        try:
            while (driven_s := time.monotonic() - began_s) < options.seconds:
                # The last command holds just until the end.
                if holds_until_s < options.seconds:
                    hold_s = min(HOLD_MS / 1000, options.seconds - driven_s)
                    control.drive(left, right, max(1, round(hold_s * 1000)))
                    holds_until_s = driven_s + hold_s
                # On the grid of RESEND_S, however long the reply took.
                now_s = time.monotonic() - began_s
                due_s = (now_s // RESEND_S + 1) * RESEND_S
                time.sleep(max(0.0, min(due_s, options.seconds) - now_s))
        finally:
            state = control.stop()
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
        else:
            device = stack.enter_context(TerminalKeys(options.speed))
            how = "hold W A S D or arrows; space stops, R lets the policy run, Q ends"
        link = stack.enter_context(options.link())
        session = HandSession(link, lambda words: print(f"{link.robot_id}: {words}", flush=True))
        with session:
            print(f"{link.robot_id}: {how}", flush=True)
            session.follow(device)
