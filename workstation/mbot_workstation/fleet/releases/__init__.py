"""Releases of the daemon: made here, signed, sent to robots."""
