"""A stand-in for a serial-line board on a pty, with the faults a real one can have."""

import os
import pty
import re
import select
import threading
import tty
from typing import Self

NAME = "serial-line 1 300ms"
_DRIVE = re.compile(r"D[+-]\d{3}[+-]\d{3}")


class LineBoard:
    """Obeys lines as the sketch does, but knows no time-out; keeps those that it has obeyed.

    Attributes:
        path: the port to open.
        lines: what was obeyed, asking for its name included.
        mute: hears nothing.
        armed: whether it may drive.
        garbled: what it says instead of the next echo.

    """

    def __init__(self, name: str = NAME) -> None:
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        self.path = os.ttyname(self._slave)
        self.name, self.lines, self.garbled = name, list[str](), ""
        self.mute = self.armed = self._closing = False
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing = True
        self._thread.join(2)
        os.close(self._master)
        os.close(self._slave)

    @property
    def last(self) -> str:
        return self.lines[-1] if self.lines else ""

    @property
    def stands(self) -> bool:
        return self.last in ("S", "D+000+000")

    def say(self, line: str) -> None:
        os.write(self._master, f"{line}\r\n".encode())

    def reset(self) -> None:
        self.armed = False
        self.say(f"boot {self.name}")

    def _run(self) -> None:
        heard = b""
        while not self._closing:
            if select.select([self._master], [], [], 0.02)[0]:
                *whole, heard = (heard + os.read(self._master, 4096)).split(b"\n")
                for line in whole:
                    self._obey(line.decode())

    def _obey(self, line: str) -> None:
        is_drive = _DRIVE.fullmatch(line) and (self.armed or line == "D+000+000")
        if self.mute or not (is_drive or line in ("V", "A", "S")):
            return
        self.armed = self.armed or line == "A"
        self.lines.append(line)
        echo, self.garbled = self.garbled or line, ""
        self.say(self.name if line == "V" else echo)
