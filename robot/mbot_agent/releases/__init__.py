"""Releases of the daemon itself: received and handed to root's updater, which alone installs."""
