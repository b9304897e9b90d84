"""The command `workstation`: whatever happens ends in one line and an exit code."""

# Nothing is imported up here that takes time: Ctrl-C meanwhile would show a traceback.
import errno
import sys

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
        code = _said(f"{what}: {error.strerror}; make room on the disk", 1)
    except ModuleNotFoundError as error:
        library = (error.name or "").partition(".")[0]
        if library not in EXTRAS:
            raise
        remedy = f"pip install -c constraints.txt -e '.[{EXTRAS[library]}]' in the checkout"
        code = _said(f"this command needs {library}: {remedy}", 1)
    sys.exit(code)


def _run() -> int:
    from mbot_protocol.early_interrupt import end_at_once_on_ctrl_c

    end_at_once_on_ctrl_c("workstation")

    import typer

    from mbot_protocol.errors import MbotError
    from mbot_workstation.cli.subcommands import app

    try:
        # Exit codes come back as values, errors as exceptions: ours are lines, not boxes.
        code = app(prog_name="workstation", standalone_mode=False) or 0
        return _said("interrupted", code) if code == INTERRUPTED else code
    except MbotError as error:
        # Names and words of strangers' files may stand in it.
        words = "".join(c if c.isprintable() else " " for c in str(error))
        if "--json" in sys.argv:
            import json

            told = {"kind": error.kind, "text": words, "remedy": error.remedy, "facts": error.facts}
            print(json.dumps({"error": told}, default=str), file=sys.stderr)
            return error.exit_code
        return _said(words, error.exit_code)
    except typer.Abort:
        return _said("interrupted", INTERRUPTED)
    except Exception as error:
        from mbot_workstation.cli.usage_words import is_usage_error, usage_words

        if not is_usage_error(error):
            raise
        words = usage_words(error)
        return _said(words, USAGE) if words else USAGE


def _said(words: str, code: int) -> int:
    print(f"workstation: {words}", file=sys.stderr)
    return code


if __name__ == "__main__":
    main()
