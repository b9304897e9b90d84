"""The daemon as a process: the signals that end it, and what systemd wants to hear.

For others: `termination` and `service_manager`.
"""
