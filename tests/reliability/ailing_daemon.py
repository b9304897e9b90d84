"""The real daemon, until the file `ailment` beside its configuration names a thread and its fate.

"motors dies": an exception ends the thread. "motors hangs": it makes no progress any more.
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mbot_agent import main
from mbot_agent.board.motors import Motors
from mbot_agent.camera.capture import CaptureThread
from mbot_agent.commands.command_service import CommandService
from mbot_agent.commands.stop_service import StopService
from mbot_agent.control_loop import ControlLoop
from mbot_agent.network.presence import Presence
from mbot_agent.network.telemetry_publisher import Telemetry

_ailment = Path(sys.argv[sys.argv.index("--config") + 1]).with_name("ailment")


class Death(BaseException):
    """No `except Exception` holds this up."""


def suffer(thread: str, of: type, method: str) -> None:
    """Let what a thread does again and again look into the file first."""
    healthy: Callable[..., Any] = getattr(of, method)

    def ailing(*arguments: Any) -> Any:
        words = _ailment.read_text().split() if _ailment.exists() else []
        if words == [thread, "dies"]:
            raise Death(thread)
        if words == [thread, "hangs"]:
            time.sleep(3600)
        return healthy(*arguments)

    setattr(of, method, ailing)


if __name__ == "__main__":
    suffer("motors", Motors, "_wait")
    suffer("camera", CaptureThread, "_take")
    suffer("telemetry", Telemetry, "_send")
    suffer("stop", StopService, "take")
    suffer("confirm", StopService, "confirm")
    suffer("command", CommandService, "command")
    suffer("main", ControlLoop, "_decide")
    suffer("presence", Presence, "look")
    main.main()
