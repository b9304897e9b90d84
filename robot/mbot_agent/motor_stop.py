"""`mbot-agent stop-motors`: what systemd runs after the daemon has ended, however it ended."""

import logging
import os
import time

from mbot_agent.board_session import BoardSession
from mbot_agent.configuration import Board
from mbot_protocol.errors import UnreachableError

log = logging.getLogger(__name__)

ATTEMPTS = 3


def stop_motors(board: Board) -> None:
    """Open the port, stop the motors and wait for the board's word that they stand.

    Opening the port resets a real board, which already turns its motors off; the handshake then
    waits for its firmware and says stop once more.

    Raises:
        UnreachableError: the board could not be told.

    """
    never, keep_open = os.pipe()
    try:
        for attempt in range(1, ATTEMPTS + 1):
            try:
                with BoardSession.open(board.port, board.baud_rate, never) as session:
                    session.handshake(lambda: False)
                    log.info("motors stopped (%s, firmware %s)", session.path, session.version)
                    return
            except UnreachableError:
                if attempt == ATTEMPTS:
                    raise
                time.sleep(0.3)
    finally:
        os.close(never)
        os.close(keep_open)
