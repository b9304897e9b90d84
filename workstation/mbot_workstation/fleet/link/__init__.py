"""The way to a robot: addresses, certificates shown, sessions, and why one did not come about."""
