"""Drives the maneuvers as a person would: a spoilt run is driven again."""

from pathlib import Path

from mbot_protocol.errors import MbotError
from mbot_workstation.measure.rehearsal.command_line import CommandLine
from mbot_workstation.measure.tracks.commands_csv import read_commands
from mbot_workstation.measure.tracks.recording_folder import COMMANDS_FILE

ATTEMPTS_WITHOUT_PROGRESS = 3
"""On a machine that is too slow for real time no attempt ever gets further."""


def drive_session(line: CommandLine, recording: str, *options: str) -> None:
    """Record all maneuvers.

    Args:
        line: to type at.
        recording: the new recording's folder, in the line's folder.
        options: of `workstation maneuvers run`, but for where to record.

    Raises:
        MbotError: several attempts in a row recorded nothing more.

    """
    command = ["workstation", "maneuvers", "run", *options]
    folder = line.folder / recording
    done, failures = 0, 0
    where = ["--output", recording]
    while True:
        try:
            line.run(*command, *where, quiet=True)
        except MbotError as error:
            now = _recorded(folder)
            failures = 0 if now > done else failures + 1
            done = now
            if failures >= ATTEMPTS_WITHOUT_PROGRESS:
                raise
            line.say(f"a run was spoilt ({error.facts.get('said', error)}); go on")
            if done or (folder / COMMANDS_FILE).exists():
                where = ["--resume", recording]
        else:
            return


def _recorded(folder: Path) -> int:
    """How many runs are there."""
    path = folder / COMMANDS_FILE
    return len(read_commands(path, may_be_empty=True)) if path.exists() else 0
