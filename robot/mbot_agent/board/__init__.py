"""The mCore board: its port, frames out, acknowledgements in, and the last word on stopping.

For others: `motors.Motors`, the board as the loop sees it; `motor_stop.stop_motors`, what systemd
runs after the daemon; `board_session.BoardSession`, one open connection, for `mbot-agent check`.
"""
