"""From one release to another, step by step, each of which may be the last one before a power cut.

The link `current` says what runs. Before it is turned to a release that has yet to show itself,
the ledger names where it came from; whoever finds that name there later goes back. So at any moment
the old release is what a boot starts, until the one write that accepts the new one.
"""

import sys
import time
from dataclasses import replace
from typing import IO

from mbot_protocol.errors import MbotError, RefusedError
from mbot_protocol.signing.public_key import PublicKey
from mbot_protocol.signing.release_ledger import BUSY, Ledger, Outcome
from mbot_update import health_gate, short_lives, system, taking_in
from mbot_update.release_folders import BEFORE_RELEASES, ReleaseFolders

GIVES_UP_WITHIN_S = 3.0
"""More than the unit's RestartSec: the last start follows a death by that, and is refused."""

DIED = "it died again and again after it had been accepted"


def work(folders: ReleaseFolders) -> Outcome:
    """Carry out the daemon's request, if there is one; what became of it."""
    recover(folders)
    if not taking_in.is_asked(folders):  # it has been given up, as after a power cut
        return folders.ledger.outcome
    try:
        number, archive = taking_in.open_request(folders)
    except RefusedError as error:
        return _refused(folders, "", error)
    try:
        with archive:
            trusted = system.release_keys(folders.configuration)
            return update(folders, archive, number, trusted)
    except MbotError as error:
        return _refused(folders, number, error)


def update(
    folders: ReleaseFolders,
    archive: IO[bytes],
    number: str = "",
    trusted: tuple[PublicKey, ...] | None = None,
) -> Outcome:
    """Take an archive in, build it and change over to it.

    Raises:
        RefusedError: it is not for this robot, damaged, or can't be built; nothing has changed.

    """
    _note_phase(folders, number, "", "checking")
    manifest = taking_in.unpack(folders, archive, trusted)
    _note_phase(folders, number, manifest.version, "building")
    taking_in.forget_request(folders)
    taking_in.build(folders, manifest)
    return change_over(folders, manifest.version, number, manifest.floor)


def change_over(folders: ReleaseFolders, version: str, number: str = "", floor: int = 0) -> Outcome:
    """Make a whole release the one that runs, if it runs as well as the old one.

    A daemon that does not run is not started: then only what can be tried beside it is.

    Raises:
        RefusedError: it would not run, or the robot is in motion; nothing has changed.

    """
    old, before = folders.current, system.service()
    if version == old:
        short_lives.start_over(folders)
        outcome = Outcome(number, version, "installed", version)
        folders.note(replace(folders.ledger.accepted(version, version, floor), outcome=outcome))
        return outcome
    if before.is_armed:
        raise RefusedError("the robot has been set in motion: stop it and try again")
    if why := health_gate.would_not_run(folders, version, old):
        raise RefusedError(f"{version} does not run here: {why}")
    trying = Outcome(number, version, "trying", f"{version} instead of {old or 'nothing'}")
    folders.note(replace(folders.ledger, came_from=old, outcome=trying))
    folders.switch(version)
    system.reload_units()
    runs = before.state in ("active", "activating", "reloading")
    if runs and old and (why := health_gate.is_worse(before, old)):
        if not system.is_up():
            raise system.GoingDownError("the machine goes down: whoever recovers goes back")
        return _go_back(folders, version, number, why)
    outcome = Outcome(number, version, "installed", f"{version} runs" if runs else version)
    # One of before there were releases goes as soon as a release has shown itself in its place.
    replaced = "" if old == BEFORE_RELEASES and runs else old
    ledger = folders.ledger.accepted(version, replaced, floor)
    try:
        folders.note(replace(ledger, outcome=outcome))
    except OSError as error:
        # It would run on, though nobody has accepted it, until a boot goes back unasked.
        return _go_back(folders, version, number, f"the disk takes no note of it: {error.strerror}")
    short_lives.start_over(folders)
    folders.sweep()
    return outcome


def recover(folders: ReleaseFolders, keep: str = "") -> None:
    """Put right what a power cut or a kill has left in the middle of an update.

    Args:
        folders: of this robot.
        keep: a release that is about to be adopted.

    """
    ledger = folders.ledger
    outcome = ledger.outcome
    went_back = False
    if ledger.came_from:
        went_back = folders.current != ledger.came_from
        folders.switch(ledger.came_from)
    if outcome.phase in BUSY:
        why = f"interrupted while {outcome.phase}; {folders.current or 'nothing'} runs: try again"
        outcome = replace(outcome, phase="failed", detail=why)
        taking_in.forget_request(folders)
    folders.note(replace(ledger, came_from="", outcome=outcome))
    if went_back:
        system.reload_units()
        if system.service().state not in ("", "inactive"):
            system.restart()
    folders.sweep(keep)


def is_given_up(folders: ReleaseFolders) -> bool:
    """Whether the daemon's release has died young too often, or systemd won't start it again.

    From version 254 on systemd takes OnFailure= for every end of a daemon that it is about to start
    again, before only for the last one.
    """
    until_s = time.monotonic() + GIVES_UP_WITHIN_S
    # The count each time: a death while this waits starts no second one of it.
    while not (short_lives.too_many(folders) or system.service().state == "failed"):
        if time.monotonic() >= until_s:
            return False
        time.sleep(0.2)
    return True


def put_back_by_itself(folders: ReleaseFolders) -> Outcome:
    """The daemon's unit has failed: go back to the release before, or else to the golden one.

    Raises:
        RefusedError: that would not help, or there is none.

    """
    found = system.service()
    if (found.result, found.exit_status) == ("exit-code", system.WRONG_CONFIGURATION):
        raise RefusedError("the daemon ended because of its configuration, not of its release")
    if found.result in short_lives.BY_FIRE and short_lives.is_under_fire(folders):
        system.start_without_waiting()
        raise RefusedError("the daemon was flooded with messages: that is not its release's fault")
    current, ledger = folders.current, folders.ledger
    target = _other(folders, barred=frozenset(ledger.rejected))
    outcome = Outcome("", current, "rolled-back", f"{DIED}: {target} runs")
    ledger = replace(ledger.with_rejected(current, DIED), came_from=target, outcome=outcome)
    _note_if_possible(folders, ledger)
    folders.switch(target)
    system.reload_units()
    system.start_without_waiting()
    previous = "" if target == ledger.previous else ledger.previous
    folders.sweep()  # first: on a disk that was full there is room for a note again
    _note_if_possible(folders, replace(ledger, came_from="", previous=previous))
    return outcome


def put_back_by_hand(folders: ReleaseFolders) -> Outcome:
    """A person wants the release before; raises RefusedError where there is none."""
    recover(folders)
    return change_over(folders, _other(folders, barred=frozenset()))


def _other(folders: ReleaseFolders, barred: frozenset[str]) -> str:
    ledger = folders.ledger
    for version in (ledger.previous, ledger.golden):
        if version not in barred | {folders.current} and folders.is_whole(version):
            return version
    raise RefusedError("there is no other release to go back to")


def _go_back(folders: ReleaseFolders, version: str, number: str, why: str) -> Outcome:
    """The old release runs before anything is noted: a disk that takes no note must not keep the
    new one running. Until it is noted, whoever finds the ledger goes back once more."""
    old = folders.ledger.came_from
    folders.switch(old)
    system.reload_units()
    runs = f"{old} runs again" if system.restart() else f"{old} is back, but not READY"
    outcome = Outcome(number, version, "rolled-back", f"{why}; {runs}")
    ledger = replace(folders.ledger.with_rejected(version, why), came_from="", outcome=outcome)
    folders.sweep()  # first: on a disk that was full there is room for a note again
    _note_if_possible(folders, ledger)
    return outcome


def _note_if_possible(folders: ReleaseFolders, ledger: Ledger) -> None:
    """A robot that drives matters more than a disk that is full."""
    try:
        folders.note(ledger)
    except OSError as error:
        print(f"mbot-agent: not noted: {error}", file=sys.stderr)


def _refused(folders: ReleaseFolders, number: str, error: MbotError) -> Outcome:
    """Nothing has changed, and nothing of it is left."""
    taking_in.forget_request(folders)
    outcome = Outcome(number, folders.ledger.outcome.version, "refused", str(error))
    folders.note(replace(folders.ledger, outcome=outcome))
    folders.sweep()
    return outcome


def _note_phase(folders: ReleaseFolders, number: str, version: str, phase: str) -> None:
    outcome = Outcome(number, version, phase, f"{phase} {version}".strip())
    folders.note(replace(folders.ledger, outcome=outcome))
