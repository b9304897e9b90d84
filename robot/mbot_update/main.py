"""The updater's command line: `python3 -I /opt/mbot-agent/updater ACTION`, as root."""

import argparse
import fcntl
import json
import os
import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from mbot_protocol.errors import MbotError, RefusedError
from mbot_protocol.signing.release_ledger import Outcome
from mbot_update import before_releases, python_packages, short_lives, update_steps
from mbot_update.release_folders import ReleaseFolders
from mbot_update.system import GoingDownError

ACTIONS = (
    *("work", "take-over", "install", "adopt", "recover"),
    *("ended", "put-back", "rollback", "releases"),
)


def main() -> int:
    """Run one action; the exit code."""
    parser = argparse.ArgumentParser(prog="mbot-agent-update", description=__doc__)
    parser.add_argument("action", choices=ACTIONS)
    parser.add_argument("release", nargs="?", default="", help="install: archive; adopt: version")
    parser.add_argument("--root", type=Path, default=Path("/"), help="what stands for /")
    parser.add_argument("--json", action="store_true", help="releases: for machines")
    arguments = parser.parse_args()
    folders = ReleaseFolders(arguments.root)
    try:
        if arguments.action == "releases":
            _show(folders, as_json=arguments.json)
            return 0
        if arguments.action == "ended":
            short_lives.count_end(folders)
            return 0
        if arguments.action == "put-back" and not update_steps.is_given_up(folders):
            print("systemd starts the daemon again by itself")
            return 0
        with _alone(folders):
            outcome = _act(arguments.action, arguments.release, folders)
    except MbotError as error:
        print(f"mbot-agent: {error}", file=sys.stderr)
        return 0 if arguments.action == "put-back" else error.exit_code
    except (OSError, GoingDownError) as error:
        print(f"mbot-agent: {error}", file=sys.stderr)
        return 1
    if outcome is None:
        return 0
    print(f"{outcome.phase}: {outcome.detail}")
    # A release that was refused is not a failure of the updater's unit.
    return 0 if outcome.phase == "installed" or arguments.action in ("work", "put-back") else 6


def _act(action: str, release: str, folders: ReleaseFolders) -> Outcome | None:
    if action == "work":
        return update_steps.work(folders)
    if action == "recover":
        update_steps.recover(folders)
        return None
    if action == "take-over":
        before_releases.take_over(folders)
        return None
    if action == "put-back":
        return update_steps.put_back_by_itself(folders)
    if action == "rollback":
        return update_steps.put_back_by_hand(folders)
    if action == "adopt":
        # Checked out and built by root: nothing is signed, and no floor is raised.
        if not folders.is_whole(release):
            python_packages.leave_out(folders.release(release) / "venv")
            folders.finish(release)
        update_steps.recover(folders, keep=release)
        return update_steps.change_over(folders, release)
    update_steps.recover(folders)
    with Path(release).open("rb") as archive:
        return update_steps.update(folders, archive)


@contextmanager
def _alone(folders: ReleaseFolders) -> Generator[None]:
    """One updater at a time, and the daemon sees that it is at work.

    Raises:
        RefusedError: another one is at work, or this is not root.

    """
    path = folders.application / "lock"
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    except OSError as error:
        raise RefusedError(f"cannot use {path}: {error.strerror}; run it with sudo") from None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        with _seen(folders.at_work):
            yield
    except BlockingIOError:
        raise RefusedError("an update is under way, and looks after itself") from None
    finally:
        os.close(descriptor)


@contextmanager
def _seen(mark: Path) -> Generator[None]:
    """While the mark is there a restarted daemon takes no order to move and begins none itself.
    systemd makes it for the updater's unit; by hand nobody does."""
    by_hand = not mark.exists()
    if by_hand:
        mark.mkdir(parents=True)
    try:
        yield
    finally:
        if by_hand:
            mark.rmdir()


def _show(folders: ReleaseFolders, *, as_json: bool) -> None:
    ledger, current = folders.ledger, folders.current
    rows = [
        {
            "version": version,
            "current": version == current,
            "previous": version == ledger.previous,
            "golden": version == ledger.golden,
        }
        for version in folders.versions()
    ]
    last = {"version": ledger.outcome.version, "phase": ledger.outcome.phase}
    last["detail"] = ledger.outcome.detail
    if as_json:
        found = {"releases": rows, "rejected": ledger.rejected, "floor": ledger.floor}
        print(json.dumps(found | {"last_update": last}))
        return
    for row in rows:
        words = [name for name in ("current", "previous", "golden") if row[name]]
        print(f"{row['version']:40} {', '.join(words)}")
    for version, why in ledger.rejected.items():
        print(f"{version:40} not taken again: {why}")
    if ledger.outcome.phase:
        print(f"last update: {ledger.outcome.phase}: {ledger.outcome.detail}")


if __name__ == "__main__":
    sys.exit(main())
