"""Ctrl-C while a program is still importing: it ends at once, in one line.

A KeyboardInterrupt would do, if Python did not swallow it: importing runs callbacks whose
exceptions are printed and ignored, and the program would go on.
"""

import os
import signal
from types import FrameType

INTERRUPTED = 130
"""Exit code, as of a shell."""

_line = ""


def end_at_once_on_ctrl_c(program: str) -> None:
    """Until `ctrl_c_as_usual`; for a program that has nothing to tidy up yet.

    Args:
        program: said to be interrupted.

    """
    global _line  # noqa: PLW0603 (a signal has one handler a process)
    _line = f"{program}: interrupted\n"
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # not of a background job
        signal.signal(signal.SIGINT, _end)


def ctrl_c_as_usual() -> None:
    """From now on Ctrl-C raises KeyboardInterrupt, if it ended the program before."""
    if signal.getsignal(signal.SIGINT) is _end:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _end(_number: int, _frame: FrameType | None) -> None:
    os.write(2, _line.encode())
    os._exit(INTERRUPTED)
