"""Boards that turn wheels: commands out, acknowledgements in, and the last word on stopping.

For others: `motors.Motors`, the board as the loop sees it; `motor_stop.stop_motors`, what systemd
runs after the daemon; `board_kinds.opener`, one open connection, for `mbot-agent check`. A kind of
board is a folder and a line of `board_kinds.KINDS`.
"""
