"""An mCore board on a pseudo-terminal: a serial port that a daemon can open, without hardware."""

import contextlib
import os
import select
import threading
import time
import tty
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from mbot_protocol.drive.mcore import Joystick
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.virtual.mcore_firmware import STOCK_VERSION, McoreFirmware
from mbot_workstation.virtual.port_link import PortLink

READ_BYTES = 4096
TRACE_STATES = 10_000
OPENED_POLL_S = 0.01
"""How often to look whether somebody has opened the port; only while nobody has, and only with a
boot time, since opening is not signalled."""


@dataclass(frozen=True, slots=True)
class BoardState:
    """What the board's motors do.

    Attributes:
        motors: the speeds in force; they stay in force for ever.
        since_s: monotonic time at which they were set, by a command or by a reset.
        commands: how many motor commands have been obeyed since the start.
        silent_ms: how long the host had been silent when the board stopped its motors by itself; 0
            where it was told to.

    """

    motors: Joystick
    since_s: float
    commands: int
    silent_ms: float = 0.0


class McoreBoard:
    """A board behind a pty, answered by a thread of its own; use it in a `with`.

    A real board resets whenever its port is opened (DTR), turns its motors off and is deaf until
    its boot loader is through. With `boot_s` above 0 so does this one, at every opening. With 0
    it is always ready, and opening or closing the port changes nothing.

    Attributes:
        path: the port to open: `link` where one was given, else the pty's own name.
        state: what the motors do now.
        connected: whether anybody has the port open, as far as noticed; always with 0 boot time.
        trace: the states the motors have been in, oldest first; the last ten thousand.

    """

    def __init__(
        self, link: Path | None = None, *, boot_s: float = 0.0, version: str = STOCK_VERSION
    ) -> None:
        self._firmware = McoreFirmware(version)
        self._boot_s = boot_s
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        name = os.ttyname(self._slave)
        self.path = link or Path(name)
        try:
            self._link = PortLink(link, name) if link else None
        except ConfigurationError:
            os.close(self._master)
            os.close(self._slave)
            raise
        self.state = BoardState(Joystick(0, 0), time.monotonic(), 0)
        self.trace = deque([self.state], maxlen=TRACE_STATES)
        self._wake_reader, self._wake_writer = os.pipe()
        self.connected = boot_s == 0
        self._closing = False
        self._reset_wanted = False
        self._thread = threading.Thread(target=self._serve, name="mcore-board", daemon=True)

    def __enter__(self) -> Self:
        if self._boot_s > 0:
            # Only when no one holds the other end can an opening be seen.
            os.close(self._slave)
            self._slave = -1
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing = True
        os.write(self._wake_writer, b"x")
        self._thread.join()
        for descriptor in (self._master, self._slave, self._wake_reader, self._wake_writer):
            if descriptor >= 0:
                os.close(descriptor)
        if self._link is not None:
            self._link.remove()

    def reset(self) -> None:
        """Reset the board, as a dip of its supply would."""
        self._reset_wanted = True
        os.write(self._wake_writer, b"x")

    def _serve(self) -> None:
        while not self._closing:
            if not self.connected:
                self.connected = self._is_open()
                if self.connected:
                    self._boot()
                else:
                    select.select([self._wake_reader], [], [], OPENED_POLL_S)
                continue
            ready, _, _ = select.select([self._master, self._wake_reader], [], [])
            if self._wake_reader in ready:
                os.read(self._wake_reader, 1)
            if self._reset_wanted:
                self._reset_wanted = False
                self._boot()
            elif self._master in ready:
                self.connected = self._exchange()

    def _is_open(self) -> bool:
        """Whether anyone holds the slave's end."""
        poll = select.poll()
        poll.register(self._master, select.POLLIN)
        return not any(event & select.POLLHUP for _, event in poll.poll(0))

    def _boot(self) -> None:
        """Motors off; deaf for the boot time; then the banner."""
        self._firmware.reset()
        self._note()
        until_s = time.monotonic() + self._boot_s
        while (left_s := until_s - time.monotonic()) > 0 and not self._closing:
            select.select([self._wake_reader], [], [], left_s)
        with contextlib.suppress(OSError):  # nobody there any more, or nothing to read
            while os.read(self._master, READ_BYTES):
                pass
        self._write(self._firmware.banner)

    def _exchange(self) -> bool:
        """Read, obey, answer. False when the last one to hold the port has closed it."""
        try:
            data = os.read(self._master, READ_BYTES)
        except BlockingIOError:
            return True
        except OSError:  # EIO
            return False
        reply = bytearray()
        for byte in data:  # one at a time, so that the trace misses no state
            reply += self._firmware.feed(bytes((byte,)))
            if self._firmware.commands != self.state.commands:
                self._note()
        self._write(bytes(reply))
        return True

    def _note(self) -> None:
        self.state = BoardState(self._firmware.motors, time.monotonic(), self._firmware.commands)
        self.trace.append(self.state)

    def _write(self, reply: bytes) -> None:
        # A host that never reads fills the pty; a real board's replies are lost then as well.
        with contextlib.suppress(OSError):
            os.write(self._master, reply)
