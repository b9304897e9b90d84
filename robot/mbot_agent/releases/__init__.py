"""Releases of the daemon itself: received and handed to root's updater, which alone installs.

For others: `release_service.ReleaseService` answers queries; `own_release` says which release this
daemon runs from, and whether an update goes on.
"""
