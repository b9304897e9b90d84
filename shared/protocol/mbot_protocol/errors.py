"""The one error type whose text is meant for a person, and the exit codes."""


class MbotError(Exception):
    """Something a person can mend.

    Its text is one line: what was found, what was expected, what to do. The commands print it
    without a traceback and exit with `exit_code`.
    """

    exit_code = 1


class InterruptedByUserError(MbotError):
    """Ctrl-C (exit code 130, as of a shell)."""

    exit_code = 130


class ConfigurationError(MbotError):
    """A setting, an option or a file given by the user is unusable (exit code 2, as argparse)."""

    exit_code = 2


class ContractError(MbotError):
    """A model or picture does not fit the policy contract (exit code 3)."""

    exit_code = 3


class UnreachableError(MbotError):
    """The other side, the camera or the board does not answer (exit code 4)."""

    exit_code = 4


class NewerSchemaError(MbotError):
    """The other side speaks a newer schema than this one knows (exit code 5)."""

    exit_code = 5


class RefusedError(MbotError):
    """The other side answered and said no (exit code 6)."""

    exit_code = 6


ARMED_BUT_STANDING = 7
"""Exit code of a `run` that has armed the robot while a fault keeps it standing: no error, but it
does not drive yet."""
