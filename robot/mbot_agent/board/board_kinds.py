"""The kinds of boards: a line each."""

from collections.abc import Callable

from mbot_agent.board.board_session import BoardSession
from mbot_agent.board.gpio.gpio_session import GpioSession
from mbot_agent.board.lines.line_session import LineSession
from mbot_agent.board.mcore.mcore_session import McoreSession
from mbot_agent.configuration import BoardSettings
from mbot_protocol.errors import ConfigurationError

Opener = Callable[[BoardSettings, int | None], BoardSession]
"""Finds and opens the port of a board as configured; nothing is sent yet. The number is a pipe
that interrupts `BoardSession.wait`, if somebody may want to. Raises UnreachableError."""

KINDS: dict[str, Opener] = {
    "mcore": McoreSession.open,
    "serial-line": LineSession.open,
    "gpio": GpioSession.open,
}
"""By what `board.kind` says. A table, and no import by a name in a file: what can drive the wheels
is written here."""


def opener(board: BoardSettings) -> Opener:
    """What opens a board of this kind.

    Raises:
        ConfigurationError: nobody knows it.

    """
    if (found := KINDS.get(board.kind)) is None:
        raise ConfigurationError(
            f"board.kind is {board.kind!r}, expected one of {', '.join(KINDS)}"
        )
    return found
