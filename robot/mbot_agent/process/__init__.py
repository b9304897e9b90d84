"""The daemon as a process: how it ends and has ended, its log, and what systemd hears of it.

For others: `termination`, `last_end`, `journal`, `watchdog` and `service_manager`.
"""
