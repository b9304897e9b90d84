"""`workstation run`, `stop` and `drive`: command a robot."""

from dataclasses import dataclass

from mbot_workstation.commands.link_options import LinkOptions
from mbot_workstation.commands.options import argument, option, with_options

RESEND_S = 0.2
HOLD_MS = 500
"""Two commands in a row may be lost before the robot stops between them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions(LinkOptions):
    """What `run` takes."""

    when_ready: bool = option(
        False, "Also if it cannot drive yet: begin as soon as it can.", "--when-ready"
    )


@with_options
def run(options: RunOptions) -> None:
    """Let the robot's active model drive. With a fault in the way it refuses and says which.

    Example: `workstation run --robot mbot-1.local`
    """
    import sys

    from mbot_workstation.link.remote_control import RemoteControl
    from mbot_workstation.wording import fault_lines

    with options.link() as link:
        state = RemoteControl(link).run(when_ready=options.when_ready)
        print(f"{link.robot_id}: {state}")
        if state == "fault":
            for line in fault_lines(link.status().faults):
                print(f"workstation: {line}", file=sys.stderr)


@with_options
def stop(options: LinkOptions) -> None:
    """Stop the robot. Exit code 0 means that its board has confirmed that it stands.

    Example: `workstation stop --robot mbot-1.local`
    """
    from mbot_workstation.link.remote_control import RemoteControl

    with options.link() as link:
        print(f"{link.robot_id}: {RemoteControl(link).stop()}")


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveOptions(LinkOptions):
    """What `drive` takes."""

    left: float = argument("Left wheel; 1 is full forward.", min=-1, max=1)
    right: float = argument("Right wheel, likewise.", min=-1, max=1)
    seconds: float = option(1.0, "How long.", "--for", metavar="SECONDS", min=0.1, max=600)


@with_options
def drive(options: DriveOptions) -> None:
    """Drive by hand for some seconds, then stop; Ctrl-C stops at once.

    The command is sent again five times a second and holds for half a second, so the robot also
    stops when this machine or the link dies.

    Example: `workstation drive 0.4 -0.4 --for 2 --robot mbot-1.local`
    """
    import math
    import time

    from mbot_protocol.errors import ConfigurationError
    from mbot_workstation.link.remote_control import RemoteControl

    if not (math.isfinite(options.left) and math.isfinite(options.right)):
        raise ConfigurationError(
            f"wheels are {options.left}, {options.right}, expected numbers in [-1, 1]"
        )
    with options.link() as link:
        control = RemoteControl(link)
        control.synchronise()  # before anything moves: the first command must not come late
        began_s = time.monotonic()
        try:
            while (driven_s := time.monotonic() - began_s) < options.seconds:
                # The last command holds no longer than asked for.
                left_ms = max(1, round((options.seconds - driven_s) * 1000))
                control.drive(options.left, options.right, min(HOLD_MS, left_ms))
                # On the grid of RESEND_S, however long the reply took.
                now_s = time.monotonic() - began_s
                due_s = (now_s // RESEND_S + 1) * RESEND_S
                time.sleep(max(0.0, min(due_s, options.seconds) - now_s))
        finally:
            state = control.stop()
        print(f"{link.robot_id}: {state}")
