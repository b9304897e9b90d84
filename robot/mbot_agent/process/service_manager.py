"""What systemd wants to hear, over the datagram socket in $NOTIFY_SOCKET (sd_notify(3))."""

import os
import socket


def notify(message: str) -> None:
    """Send one notification, such as "READY=1"; nothing happens when not run by systemd."""
    address = os.environ.get("NOTIFY_SOCKET")
    if not address:
        return
    if address.startswith("@"):  # an abstract socket
        address = "\0" + address[1:]
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as sender:
            sender.setblocking(False)
            sender.sendto(message.encode(), address)
    except OSError:
        pass  # a deaf service manager is no reason to stop; its watchdog will say so
