"""The whole system at once: virtual robot, real daemon, push, telemetry, and what is left of it."""
