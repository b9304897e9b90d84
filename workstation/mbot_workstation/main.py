"""The command `workstation`: whatever happens ends in one line and an exit code."""

# Nothing is imported up here that takes time: Ctrl-C meanwhile would show a traceback.
import errno
import sys

from mbot_protocol.errors import MbotError

EXTRAS = dict.fromkeys(("gymnasium", "joblib", "stable_baselines3", "torch"), "train") | {
    "scipy": "measure"
}
"""Of pyproject.toml, by the library that is missing without each."""

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
USAGE, INTERRUPTED = 2, 130


def main() -> None:
    """Run the command line and end the process."""
    try:
        code = _run()
    except KeyboardInterrupt:
        code = _said("interrupted", INTERRUPTED)
    except OSError as error:
        if error.errno not in NO_ROOM:
            raise
        what = f"can't write {error.filename}" if error.filename else "can't write any more"
        full = MbotError(
            f"{what}: {error.strerror}", kind="no-room", remedy="make room on the disk"
        )
        code = _told(full)
    except ModuleNotFoundError as error:
        library = (error.name or "").partition(".")[0]
        if library not in EXTRAS:
            raise
        remedy = f"pip install -c constraints.txt -e '.[{EXTRAS[library]}]' in the checkout"
        code = _told(MbotError(f"this command needs {library}: {remedy}", kind="no-library"))
    sys.exit(code)


def _run() -> int:
    from mbot_protocol.early_interrupt import end_at_once_on_ctrl_c

    end_at_once_on_ctrl_c("workstation")

    import typer

    from mbot_workstation.cli.subcommands import app

    try:
        # Exit codes come back as values, errors as exceptions: ours are lines, not boxes.
        code = app(prog_name="workstation", standalone_mode=False) or 0
        return _said("interrupted", code) if code == INTERRUPTED else code
    except MbotError as error:
        return _told(error)
    except typer.Abort:
        return _said("interrupted", INTERRUPTED)
    except Exception as error:
        from mbot_workstation.cli.usage_words import is_usage_error, usage_error

        if not is_usage_error(error):
            raise
        found = usage_error(error)
        return _told(found) if found is not None else USAGE


def _told(error: MbotError) -> int:
    """In a line, or in JSON where a program reads; its exit code."""
    # Names and words of strangers' files may stand in it.
    words = "".join(c if c.isprintable() else " " for c in str(error))
    if "--json" not in sys.argv:
        return _said(words, error.exit_code)
    import json

    told = {"kind": error.kind, "text": words, "remedy": error.remedy, "facts": error.facts}
    print(json.dumps({"error": told}, default=str), file=sys.stderr)
    return error.exit_code


def _said(words: str, code: int) -> int:
    print(f"workstation: {words}", file=sys.stderr)
    return code


if __name__ == "__main__":
    main()
