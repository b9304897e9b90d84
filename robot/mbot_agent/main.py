"""The command `mbot-agent`."""

# Nothing is imported up here that takes time: Ctrl-C meanwhile would show a traceback.
import os
import sys

TYPE_CHECKING = False  # typing itself takes 10 ms to import
if TYPE_CHECKING:
    import argparse
    from pathlib import Path

    from mbot_agent.process.journal import Journal

DEFAULT_PATH = "/etc/mbot-agent/config.toml"
UPDATER = "/opt/mbot-agent/updater"

INTERRUPTED = 130

EPILOG = """examples:
  mbot-agent check                       is everything there that driving needs?
  mbot-agent run --config robot.toml     run in the foreground; Ctrl-C stops the motors and ends
  systemctl start mbot-agent             run as a service
  mbot-agent releases                    those installed here; `rollback` goes back, as root
"""


def main() -> None:
    """Run the command line and end the process, whatever threads are left."""
    try:
        code = _run()
        sys.stdout.flush()
    except KeyboardInterrupt:
        print("mbot-agent: interrupted", file=sys.stderr)
        code = INTERRUPTED
    # Not sys.exit: a thread of Zenoh's or OpenCV's that hangs would keep a broken daemon alive,
    # and systemd would never restart it (measured; zenoh-python issue 434).
    os._exit(code)


def _run() -> int:
    """The exit code."""
    from mbot_protocol.early_interrupt import ctrl_c_as_usual, end_at_once_on_ctrl_c

    end_at_once_on_ctrl_c("mbot-agent")

    from mbot_agent.process import termination
    from mbot_protocol.errors import MbotError

    arguments = _parser().parse_args()
    if arguments.version:
        from mbot_agent import installed_version

        print(f"mbot-agent {installed_version()}")
        return 0
    if arguments.action == "run":
        # Before numpy or OpenCV is imported: a thread of theirs that does not inherit the mask
        # would take the signal, and the process would die with the motors running.
        termination.block_signals()
    import logging

    from mbot_agent.process.journal import Journal

    journal = Journal(verbose=arguments.verbose)
    ctrl_c_as_usual()
    try:
        return _dispatch(arguments, journal)
    except MbotError as error:
        journal.say(f"mbot-agent: {error}")
        return error.exit_code
    except KeyboardInterrupt:
        raise
    except BaseException:
        logging.getLogger(__name__).exception("mbot-agent: internal error, please report it")
        return termination.THREAD_DIED
    finally:
        journal.drain()


def _parser() -> "argparse.ArgumentParser":
    from pathlib import Path

    from mbot_agent.process.one_line_parser import OneLineParser

    parser = OneLineParser(
        prog="mbot-agent",
        description="Drives a Makeblock mBot by a camera policy.",
        epilog=EPILOG,
    )
    parser.add_argument(
        "action",
        nargs="?",
        choices=("run", "check", "stop-motors", "try", "releases", "rollback"),
        default="run",
        help="run the daemon (default), check the robot, just stop the motors, try "
        "configuration and model without hardware, list the installed releases, or go back to the "
        "previous one",
    )
    parser.add_argument(
        "--config",
        type=Path,
        default=Path(DEFAULT_PATH),
        metavar="FILE",
        help="configuration (default: %(default)s)",
    )
    parser.add_argument("--json", action="store_true", help="check, releases: for machines")
    parser.add_argument("--verbose", "-v", action="store_true", help="log more")
    parser.add_argument("--version", action="store_true", help="print it and end")
    return parser


def _dispatch(arguments: "argparse.Namespace", journal: "Journal") -> int:
    if arguments.action == "stop-motors":
        return _stop_motors(arguments.config)
    if arguments.action in ("releases", "rollback"):
        return _ask_updater(arguments.action, as_json=arguments.json)
    if arguments.action == "check":
        return _check(arguments.config, as_json=arguments.json)
    from mbot_agent.process import small_memory

    small_memory.let_unused_numpy_wait()

    from mbot_agent.configuration_files import complete

    configuration = complete(arguments.config)
    if arguments.action == "try":
        from mbot_agent.daemon import rehearse

        print(rehearse(configuration))
        return 0
    from importlib import import_module

    small_memory.share_one_pool()
    with small_memory.without_openssl():
        from mbot_agent import daemon

        if configuration.camera.source.startswith("http://"):
            import_module("http.client")  # before the camera's thread finds OpenSSL with it

    daemon.run(configuration, journal.drain)
    return 0


def _stop_motors(path: "Path") -> int:
    """Even a broken configuration must not keep the motors turning."""
    from mbot_agent.board.motor_stop import stop_motors
    from mbot_agent.configuration import load_board

    stop_motors(load_board(path))
    return 0


def _ask_updater(action: str, *, as_json: bool) -> int:
    """A program of its own, which works when nothing of the daemon does."""
    from pathlib import Path

    from mbot_protocol.errors import ConfigurationError

    if not Path(UPDATER).is_dir():
        raise ConfigurationError(f"there is no {UPDATER}: deploy/install.sh installs releases")
    command = ["/usr/bin/python3", "-I", "-B", UPDATER, action, *(["--json"] if as_json else [])]
    os.execv(command[0], command)


def _check(path: "Path", *, as_json: bool) -> int:
    import json

    _check_readable(path)

    from mbot_agent.configuration_files import complete, keys_by_file

    configuration = complete(path)

    from mbot_agent.doctor import examine

    findings = examine(configuration, keys_by_file(path))
    try:
        for finding in findings:
            if as_json:
                print(json.dumps({name: getattr(finding, name) for name in finding.__slots__}))
            else:
                print(f"{finding.verdict:8} {finding.subject:8} {finding.detail}")
        sys.stdout.flush()
    except BrokenPipeError:  # who read has read enough, as `head` has
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 1 if any(finding.verdict == "failed" for finding in findings) else 0


def _check_readable(path: "Path") -> None:
    """The configuration is for root's and the daemon's eyes: say who has to ask instead."""
    import pwd
    from pathlib import Path

    from mbot_protocol.errors import ConfigurationError

    try:
        path.open("rb").close()
    except PermissionError:
        try:
            user = pwd.getpwuid(os.geteuid()).pw_name
        except KeyError:  # no such user in a container
            user = f"user {os.geteuid()}"
        config = "" if path == Path(DEFAULT_PATH) else f" --config {path}"
        raise ConfigurationError(
            f"can't read {path} as {user}; run it as the daemon's user: sudo -u mbot-agent "
            f"mbot-agent check{config}"
        ) from None
    except OSError:
        pass  # whatever else it is, reading says so


if __name__ == "__main__":
    main()
