"""`workstation update`: a release of the daemon onto a robot."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mbot_workstation.cli.link_options import LinkOptions, json_option
from mbot_workstation.cli.options import argument, with_options

if TYPE_CHECKING:
    from mbot_protocol.v1.messages_pb2 import ReleaseUpdate
    from mbot_workstation.fleet.link.robot_link import RobotLink
    from mbot_workstation.fleet.releases.send_release import CheckedRelease


@dataclass(frozen=True, slots=True, kw_only=True)
class UpdateOptions(LinkOptions):
    """What `update` takes."""

    release: Path = argument("What `make dist` has made.", metavar="RELEASE.tar")
    as_json: bool = json_option()


@with_options
def update(options: UpdateOptions) -> None:
    """Send a release of the daemon to a robot and wait until it runs there.

    The robot takes releases signed by a key in its `[trust] release_keys`, while it is not armed.
    It builds the release beside the one that runs, restarts with it, and goes back by itself if
    that is not READY in time or sees or reaches less than before. `mbot-agent rollback` there goes
    back later.

    Example: `workstation update mbot-agent-0.1.0.tar --robot mbot-1`
    """
    import json

    from mbot_protocol.errors import InterruptedByUserError, RefusedError
    from mbot_workstation.fleet.releases.send_release import check_release_file
    from mbot_workstation.wording import one_line

    checked = check_release_file(options.release)
    try:
        with options.link() as link:
            name, found = link.robot_id, _update_with_bar(link, checked)
    except KeyboardInterrupt:
        raise InterruptedByUserError(
            "interrupted; if all had been sent, the robot goes on without us: `mbot-agent "
            "releases` there says what became of it"
        ) from None
    version, detail = checked.manifest.version, one_line(found.detail)
    if options.as_json:
        words = {"robot_id": name, "version": version, "outcome": found.phase, "detail": detail}
        print(json.dumps(words))
    if found.phase != "installed":
        raise RefusedError(f"{name} does not run {version}: {found.phase}: {detail}")
    if not options.as_json:
        print(f"{name} now runs {version}")


def _update_with_bar(link: "RobotLink", release: "CheckedRelease") -> "ReleaseUpdate":
    from mbot_workstation.cli.transfer_bar import transfer_bar
    from mbot_workstation.fleet.releases.send_release import send, wait_for_outcome

    with transfer_bar() as progress:
        task = progress.add_task(f"sending to {link.robot_id}", total=release.size_bytes)
        push_id = send(link, release, lambda sent, _: progress.update(task, completed=sent))

        def show(phase: str) -> None:
            progress.update(task, description=f"{link.robot_id} is {phase} it")

        show("checking")
        return wait_for_outcome(link, push_id, show)
