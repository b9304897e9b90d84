"""Types the commands a person would type, shows them, and keeps what they say."""

import os
import shlex
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from mbot_protocol.errors import MbotError

LAST_LINES = 3
END_TIMEOUT_S = 10.0

ENVIRONMENT = {"MBOT_ROBOT": "", "COLUMNS": "110"}
"""A robot that somebody has set for this shell is not the one rehearsed with."""


class CommandLine:
    """Runs this installation's programs in one folder.

    Attributes:
        folder: where commands run; relative paths count from there.
        console: where they are shown.

    """

    def __init__(self, folder: Path, console: Console) -> None:
        self.folder = folder
        self.console = console
        self._log = folder / "log"
        self._count = 0
        self._began_s = time.monotonic()

    def step(self, title: str, words: str) -> None:
        """Announce the next part of the afternoon."""
        passed_s = time.monotonic() - self._began_s
        self.console.print()
        self.console.print(f"[bold]{escape(title)}[/]  [dim]{passed_s:.0f} s[/]", highlight=False)
        self.console.print(escape(words), highlight=False, style="dim")

    def say(self, text: str) -> None:
        """What happens here that no command does."""
        self.console.print(escape(f"  # {text}"), highlight=False, style="dim", soft_wrap=True)

    def show(self, words: Sequence[str], ending: str = "") -> None:
        """A command as it is typed."""
        line = shlex.join(words) + ending
        self.console.print(f"[bold blue]$[/] {escape(line)}", highlight=False, soft_wrap=True)

    def run(self, *words: str, to: str | None = None, quiet: bool = False) -> float:
        """Run a command to its end.

        Args:
            words: the command; `workstation` or `mbot-agent` of this installation.
            to: a file in the folder that takes what it prints.
            quiet: show only its last line.

        Returns:
            How many seconds it took.

        Raises:
            MbotError: it failed; with its last words.

        """
        self.show(words, f" > {to}" if to else "")
        self._count += 1
        self._log.mkdir(exist_ok=True)
        names = [word for word in words[1:3] if word.replace("-", "").isalpha()]
        log = self._log / f"{self._count:02}-{'-'.join(names)}.log"
        began_s = time.monotonic()
        said, code = self._follow(words, log)
        took_s = time.monotonic() - began_s
        if code != 0:
            last = " | ".join(said[-LAST_LINES:]) or "it said nothing"
            raise MbotError(
                f"`{shlex.join(words)}` failed with exit code {code}: {last}",
                kind="command-failed",
                exit_code=code,
                said=said[-1].removeprefix("workstation: ") if said else "",
            )
        if to is not None:
            (self.folder / to).write_text("\n".join(said) + "\n", encoding="utf-8")
            return took_s
        for line in said[-1:] if quiet else said:
            self.console.print(f"  {line}", markup=False, highlight=False, soft_wrap=True)
        return took_s

    def _follow(self, words: Sequence[str], log: Path) -> tuple[list[str], int]:
        program = Path(sys.executable).with_name(words[0])
        said: list[str] = []
        with (
            log.open("w", encoding="utf-8") as file,
            subprocess.Popen(
                [str(program), *words[1:]],
                cwd=self.folder,
                env=os.environ | ENVIRONMENT,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                errors="replace",
            ) as process,
            self.console.status("...") as status,
        ):
            assert process.stdout is not None
            try:
                for line in process.stdout:
                    file.write(line)
                    said.append(line.rstrip())
                    status.update(escape(line.strip()[:100]))
                return said, process.wait()
            except BaseException:
                process.terminate()
                try:
                    process.wait(END_TIMEOUT_S)
                except subprocess.TimeoutExpired:
                    process.kill()
                raise
