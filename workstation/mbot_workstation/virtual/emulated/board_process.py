"""The emulator as a child process in real time: its lines in a thread, its end with ours."""

import contextlib
import subprocess
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Self

from mbot_protocol.errors import MbotError
from mbot_workstation.virtual.emulated.board_simulator import simulator_program

END_TIMEOUT_S = 5.0
"""The emulator looks for its end every half millisecond."""


class BoardProcess:
    """A running firmware behind a pseudo-terminal; use it in a `with`.

    It ends when its input is closed, so not even a killed Python leaves it behind.

    Attributes:
        port: the terminal's name; known inside the `with`.

    """

    def __init__(
        self,
        firmware: Path,
        take: Callable[[str], None],
        *,
        boot_s: float = 0.0,
        ended: Callable[[MbotError], None] | None = None,
        program: Path | None = None,
    ) -> None:
        """Prepare it.

        Args:
            firmware: ELF or Intel HEX file.
            take: called in a thread of its own with every line of the emulator, see
                `board_simulator.c`; what it raises ends the board.
            boot_s: how long the board is deaf after its port was opened; 0: opening is not a reset.
            ended: called once, from that thread, if the board ends by itself.
            program: the compiled emulator; the one in the cache if not given.

        """
        boot_ms = round(boot_s * 1000)
        self._program = program or simulator_program()
        self._command = [str(self._program), str(firmware), "--pty", str(boot_ms)]
        self._take = take
        self._ended = ended
        self._closing = False
        self.port = ""

    def __enter__(self) -> Self:
        """Start it and wait for its port.

        Raises:
            MbotError: the emulator does not start, or does not take the firmware.

        """
        try:
            self._child = subprocess.Popen(
                self._command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                # Ctrl-C is for this program, which then ends the board in the right order.
                start_new_session=True,
            )
        except OSError as error:
            raise MbotError(f"can't start {self._program}: {error.strerror}") from None
        assert self._child.stdout is not None
        self.port = self._child.stdout.readline().strip()
        if not self.port:
            raise self._end()
        self._reader = threading.Thread(target=self._read, name="emulated-board", daemon=True)
        self._reader.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing = True
        self._end()
        self._reader.join()

    def tell(self, *lines: str) -> None:
        """Say something to the emulator, as `board_simulator.c` has it; nothing if it has ended."""
        assert self._child.stdin is not None
        with contextlib.suppress(BrokenPipeError, ValueError):  # `ended` tells why
            self._child.stdin.write("".join(f"0 {line}\n" for line in lines))
            self._child.stdin.flush()

    def _read(self) -> None:
        assert self._child.stdout is not None
        reason: MbotError | None = None
        try:
            for line in self._child.stdout:
                self._take(line)
        except MbotError as error:
            reason = error
        if not self._closing and self._ended is not None:
            self._ended(reason or self._end())

    def _end(self) -> MbotError:
        """End the process, if it has not ended; what it said last."""
        assert self._child.stdin is not None
        assert self._child.stderr is not None
        with contextlib.suppress(BrokenPipeError):
            self._child.stdin.close()
        try:
            self._child.wait(END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()
        told = " ".join(self._child.stderr.read().split()) or f"exit {self._child.returncode}"
        return MbotError(f"the emulated board has ended: {told.removeprefix('board_simulator: ')}")
