"""The network: the Zenoh session, who is there, and the daemon's values as messages.

For others: `zenoh_link.Link`, `presence.Presence`, `telemetry_publisher.Telemetry` and
`wire_messages`; for `mbot-agent check`, `tls_files.check_certificates`.
"""
