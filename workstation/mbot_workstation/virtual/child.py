"""A program run beside this one: started, watched, ended politely, its words kept in a file."""

import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Self

from mbot_protocol.errors import MbotError

END_TIMEOUT_S = 10.0
LAST_LINES = 3


class Child:
    """A running program of this installation; a context manager that ends it.

    Attributes:
        exit_code: known once it has ended; None before.

    """

    def __init__(self, program: str, arguments: list[str], log: Path) -> None:
        """Prepare to run `program`, found beside this Python, with its output in `log`."""
        self._command = [str(Path(sys.executable).with_name(program)), *arguments]
        self._log = log
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def exit_code(self) -> int | None:
        """The program's exit code; None while it runs."""
        return None if self._process is None else self._process.poll()

    @property
    def cpu_s(self) -> float:
        """Processor time used so far, user and system; 0 where the kernel does not tell."""
        try:
            if self._process is None:
                return 0.0
            fields = Path(f"/proc/{self._process.pid}/stat").read_text().rpartition(")")[2].split()
            return (int(fields[11]) + int(fields[12])) / 100.0
        except (OSError, IndexError, ValueError):
            return 0.0

    def wait_until(self, condition: Callable[[], bool], timeout_s: float, what: str) -> None:
        """Wait for something the program does.

        Raises:
            MbotError: it ended, or took too long; with its last words.

        """
        until_s = time.monotonic() + timeout_s
        while not condition():
            if self.exit_code is not None:
                raise MbotError(f"{what}: the program ended early: {self._last_words()}")
            if time.monotonic() > until_s:
                raise MbotError(f"{what}: not within {timeout_s:.0f} s: {self._last_words()}")
            time.sleep(0.05)

    def end(self) -> int:
        """Ask it to end, by force if it does not; its exit code."""
        if self._process is None:
            return 0
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGTERM)
        try:
            return self._process.wait(END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            return self._process.wait()

    def _last_words(self) -> str:
        lines = self._log.read_text(errors="replace").strip().splitlines()[-LAST_LINES:]
        return " | ".join(lines) or "it said nothing"

    def __enter__(self) -> Self:
        with self._log.open("wb") as output:
            self._process = subprocess.Popen(
                self._command,
                stdout=output,
                stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
                # Ctrl-C is for this program, which then ends the others in the right order.
                start_new_session=True,
            )
        return self

    def __exit__(self, *_: object) -> None:
        self.end()
