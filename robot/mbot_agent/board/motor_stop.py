"""`mbot-agent stop-motors`: what systemd runs after the daemon has ended, however it ended."""

import logging
import time

from mbot_agent.board import board_kinds
from mbot_agent.configuration import Board
from mbot_protocol.errors import UnreachableError

log = logging.getLogger(__name__)

TIME_LIMIT_S = 8.0
"""All attempts together; systemd's TimeoutStopSec leaves 10 s, a board that boots needs 3.5 s."""

PAUSE_S = 0.3


def stop_motors(board: Board) -> None:
    """Open the port, stop the motors and wait for the board's word that they stand.

    Opening the port resets a real mCore, which already turns its motors off; the handshake then
    waits for its firmware and says stop once more. A kind that nobody knows is taken for the usual
    one: a mistake in a file keeps nobody from stopping.

    Raises:
        UnreachableError: the board could not be told in 8 s.

    """
    open_board = board_kinds.KINDS.get(board.kind, board_kinds.KINDS[Board().kind])
    end_s = time.monotonic() + TIME_LIMIT_S
    while True:
        try:
            with open_board(board, None) as session:
                if session.handshake(lambda: time.monotonic() > end_s):
                    log.info("motors stopped (%s, %s)", session.path, session.firmware.version)
                    return
                raise UnreachableError(f"{session.path} does not confirm that the motors stand")
        except UnreachableError:
            if time.monotonic() + PAUSE_S > end_s:
                raise
            time.sleep(PAUSE_S)
