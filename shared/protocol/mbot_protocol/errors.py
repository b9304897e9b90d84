"""The one error type whose text is meant for a person, its kinds, and the exit codes."""

from typing import Any, Self


class MbotError(Exception):
    """Something a person can mend.

    Its text is one line: what was found, what was expected, what to do. The commands print it
    without a traceback and exit with `exit_code`. Code that has to tell errors apart goes by
    `kind` and `facts`, never by the text.

    Attributes:
        kind: a short slug; the class's where nobody needs a finer one.
        facts: what was found, by name with its unit; plain values.
        remedy: what to do, where it is said apart; the text ends with it.

    """

    exit_code = 1
    kind = "failed"

    def __init__(self, text: str = "", *, kind: str = "", remedy: str = "", **facts: Any) -> None:
        super().__init__(f"{text}; {remedy}" if remedy else text)
        self.kind = kind or self.kind
        self.remedy = remedy
        self.facts = facts

    def within(self, where: object) -> Self:
        """The same error, said of a file or folder."""
        error = type(self)(f"{where}: {self}", kind=self.kind, **self.facts)
        error.remedy = self.remedy
        return error


class InterruptedByUserError(MbotError):
    """Ctrl-C (exit code 130, as of a shell)."""

    exit_code = 130
    kind = "interrupted"


class ConfigurationError(MbotError):
    """A setting, an option or a file given by the user is unusable (exit code 2, as argparse)."""

    exit_code = 2
    kind = "configuration"


class ContractError(MbotError):
    """A model or picture does not fit the policy contract (exit code 3)."""

    exit_code = 3
    kind = "contract"


class UnreachableError(MbotError):
    """The other side, the camera or the board does not answer (exit code 4)."""

    exit_code = 4
    kind = "unreachable"


class NewerSchemaError(MbotError):
    """The other side speaks a newer schema than this one knows (exit code 5)."""

    exit_code = 5
    kind = "newer-schema"


class RefusedError(MbotError):
    """The other side answered and said no (exit code 6)."""

    exit_code = 6
    kind = "refused"


ARMED_BUT_STANDING = 7
"""Exit code of a `run` that has armed the robot while a fault keeps it standing: no error, but it
does not drive yet."""
