"""The updater on the robot: root's, and with nothing but the system's Python.

It puts releases of the daemon in place and takes them back. The daemon cannot: it has no rights,
and a release that does not start must be replaced without its help.
"""
