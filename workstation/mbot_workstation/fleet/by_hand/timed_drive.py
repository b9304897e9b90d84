"""Driving for some seconds by a command that is sent again and again and holds for 0.5 s."""

import math
import time

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.fleet.link.remote_control import RemoteControl

RESEND_S = 0.2
HOLD_MS = 500
"""Two commands in a row may be lost before the robot stops between them."""


def drive_for(control: RemoteControl, left: float, right: float, seconds: float) -> str:
    """Drive, then stop; also when interrupted.

    Args:
        control: of the robot.
        left, right: wheels in [-1, 1].
        seconds: how long.

    Returns:
        The robot's state afterwards, in a word.

    Raises:
        ConfigurationError: a wheel's command is no number.
        MbotError: as of `RemoteControl.drive` and `stop`.

    """
    if not (math.isfinite(left) and math.isfinite(right)):
        raise ConfigurationError(f"wheels are {left}, {right}, expected numbers in [-1, 1]")
    control.synchronise()  # before anything moves: the first command must not come late
    began_s, holds_until_s = time.monotonic(), 0.0
    try:
        while (driven_s := time.monotonic() - began_s) < seconds:
            # The last command holds just until the end.
            if holds_until_s < seconds:
                hold_s = min(HOLD_MS / 1000, seconds - driven_s)
                control.drive(left, right, max(1, round(hold_s * 1000)))
                holds_until_s = driven_s + hold_s
            # On the grid of RESEND_S, however long the reply took.
            now_s = time.monotonic() - began_s
            due_s = (now_s // RESEND_S + 1) * RESEND_S
            time.sleep(max(0.0, min(due_s, seconds) - now_s))
    finally:
        state = control.stop()
    return state
