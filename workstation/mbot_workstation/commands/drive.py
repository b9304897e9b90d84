"""`workstation run`, `stop` and `drive`: command a robot."""

from typing import Annotated

import typer

from mbot_workstation.commands.link_options import (
    CaOption,
    CertificateOption,
    IdOption,
    KeyOption,
    RobotOption,
    robot_link,
)

RESEND_S = 0.2
HOLD_MS = 500
"""Two commands in a row may be lost before the robot stops between them."""


def run(
    *,
    robot: RobotOption = "",
    robot_id: IdOption = None,
    ca: CaOption = None,
    certificate: CertificateOption = None,
    key: KeyOption = None,
) -> None:
    """Let the robot's active model drive; it begins as soon as there is no fault.

    Example: `workstation run --robot mbot-1.local`
    """
    import sys

    from mbot_workstation.link.remote_control import RemoteControl
    from mbot_workstation.wording import fault_lines

    with robot_link(robot, robot_id, ca, certificate, key) as link:
        state = RemoteControl(link).run()
        print(f"{link.robot_id}: {state}")
        if state == "fault":
            for line in fault_lines(link.status().faults):
                print(f"workstation: {line}", file=sys.stderr)


def stop(
    *,
    robot: RobotOption = "",
    robot_id: IdOption = None,
    ca: CaOption = None,
    certificate: CertificateOption = None,
    key: KeyOption = None,
) -> None:
    """Stop the robot. Exit code 0 means that it has confirmed.

    Example: `workstation stop --robot mbot-1.local`
    """
    from mbot_workstation.link.remote_control import RemoteControl

    with robot_link(robot, robot_id, ca, certificate, key) as link:
        print(f"{link.robot_id}: {RemoteControl(link).stop()}")


def drive(
    *,
    left: Annotated[float, typer.Argument(min=-1, max=1, help="Left wheel; 1 is full forward.")],
    right: Annotated[float, typer.Argument(min=-1, max=1, help="Right wheel, likewise.")],
    seconds: Annotated[
        float, typer.Option("--for", metavar="SECONDS", min=0.1, max=600, help="How long.")
    ] = 1.0,
    robot: RobotOption = "",
    robot_id: IdOption = None,
    ca: CaOption = None,
    certificate: CertificateOption = None,
    key: KeyOption = None,
) -> None:
    """Drive by hand for some seconds, then stop; Ctrl-C stops at once.

    The command is sent again five times a second and holds for half a second, so the robot also
    stops when this machine or the link dies.

    Example: `workstation drive 0.4 -0.4 --for 2 --robot mbot-1.local`
    """
    import math
    import time

    from mbot_protocol.errors import ConfigurationError
    from mbot_workstation.link.remote_control import RemoteControl

    if not (math.isfinite(left) and math.isfinite(right)):
        raise ConfigurationError(f"wheels are {left}, {right}, expected numbers in [-1, 1]")
    with robot_link(robot, robot_id, ca, certificate, key) as link:
        control = RemoteControl(link)
        control.synchronise()  # before anything moves: the first command must not come late
        began_s = time.monotonic()
        try:
            while (driven_s := time.monotonic() - began_s) < seconds:
                # The last command holds no longer than asked for.
                left_ms = max(1, round((seconds - driven_s) * 1000))
                control.drive(left, right, min(HOLD_MS, left_ms))
                # On the grid of RESEND_S, however long the reply took.
                now_s = time.monotonic() - began_s
                due_s = (now_s // RESEND_S + 1) * RESEND_S
                time.sleep(max(0.0, min(due_s, seconds) - now_s))
        finally:
            state = control.stop()
        print(f"{link.robot_id}: {state}")
