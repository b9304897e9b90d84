"""The daemon's own decide as a process beside this one: the two sides meet in the protocol only."""

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Self, TypeVar

from mbot_protocol.errors import MbotError
from mbot_protocol.policy.replay_step import ReplayAnswer, ReplayGreeting, ReplayStep, receive, send
from mbot_workstation.wording import one_line

PROGRAM = (sys.executable, "-m", "mbot_agent.main")
"""Of this very installation, whatever stands first in PATH."""

END_WAIT_S = 5.0

MOST_ASKED = 32
"""The process need not wait for each step; and its answers fit into a pipe's 64 kB, or both would
wait for ever.
"""

S = TypeVar("S", ReplayGreeting, ReplayAnswer)


class Decider:
    """A running `mbot-agent decide`. A context manager.

    Attributes:
        greeting: which model, and what computes; known once entered.

    """

    def __init__(self, model: Path, program: Sequence[str] = PROGRAM) -> None:
        """Prepare to decide by this model."""
        self._command = [*program, "decide", "--model", str(model)]

    def __enter__(self) -> Self:
        """Start it.

        Raises:
            MbotError: the model cannot be loaded; as the daemon says it.

        """
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(self._command, stdin=pipe, stdout=pipe, stderr=pipe)
        self.greeting = self._receive(ReplayGreeting)
        return self

    def __exit__(self, *_: object) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        try:
            self._process.wait(END_WAIT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def ask(self, step: ReplayStep) -> None:
        """Hand over a decision to be made. At most `MOST_ASKED` may wait for their answers.

        Raises:
            MbotError: the process has ended; as it said why.

        """
        assert self._process.stdin is not None
        try:
            send(self._process.stdin, step)
        except BrokenPipeError:
            raise self._ended() from None

    def answer(self) -> ReplayAnswer:
        """The answer to the first step that has none yet; raises as `ask`."""
        return self._receive(ReplayAnswer)

    def _receive(self, kind: type[S]) -> S:
        assert self._process.stdout is not None
        try:
            answer = receive(self._process.stdout, kind)
        except ValueError:
            answer = None
        if answer is None:
            raise self._ended()
        return answer

    def _ended(self) -> MbotError:
        assert self._process.stderr is not None
        self._process.kill()
        said = self._process.stderr.read().decode(errors="replace").strip().splitlines()
        return MbotError(one_line(said[-1]) if said else "mbot-agent ended without a word")
