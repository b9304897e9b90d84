"""The mCore board's firmware: found, compiled, written onto the board."""
