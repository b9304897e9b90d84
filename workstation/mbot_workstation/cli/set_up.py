"""Set a robot up: its board's firmware, its card before the first start, its releases."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mbot_protocol.errors import ConfigurationError, InterruptedByUserError, RefusedError
from mbot_workstation.cli.common_options import LinkOptions, hosts_option, json_option
from mbot_workstation.cli.options import argument, option, with_options
from mbot_workstation.cli.presenter import Answer, transfer_bar
from mbot_workstation.wording import one_line

if TYPE_CHECKING:
    from mbot_protocol.v1.messages_pb2 import ReleaseUpdate
    from mbot_workstation.fleet.link.robot_link import RobotLink
    from mbot_workstation.fleet.releases.send_release import CheckedRelease

OURS = Path("out/firmware/mbot-deadman.hex")


@dataclass(frozen=True, slots=True, kw_only=True)
class FlashOptions:
    """What `flash` takes."""

    port: str | None = option(
        None, "The board's port; the only CH340 on USB otherwise.", metavar="DEVICE"
    )
    image_path: Path = option(
        OURS, "Another firmware, such as the stock one.", "--hex", metavar="FILE"
    )
    force: bool = option(
        False, "Write even if the board does not answer as an mCore does.", "--force"
    )
    dry_run: bool = option(False, "Check everything, say what would be done.", "--dry-run")


@with_options
def flash(options: FlashOptions) -> None:
    """Write the firmware with a dead man's switch onto an mCore board on this machine's USB.

    `make firmware` makes it. Lift the wheels off the ground: opening the port resets the board.

    Examples:

    - `workstation flash --dry-run`
    - `workstation flash --hex stock.hex` goes back to another firmware
    """
    import shlex

    from mbot_workstation.fleet.firmware import flashing as firmware_flash

    image = firmware_flash.read_image(options.image_path)
    firmware_flash.need_avrdude()
    device = firmware_flash.find_port(options.port)
    try:
        version = firmware_flash.ask_version(device)
        print(f"{device}: firmware {version}")
        if not (options.force or firmware_flash.is_known_board(version)):
            raise RefusedError(
                f"{version!r} on {device} is not an mCore firmware known here; --force writes all "
                "the same"
            )
    except firmware_flash.NoAnswerError as error:
        if not options.force:
            raise firmware_flash.NoAnswerError(f"{error}; --force writes all the same") from None
        print(f"{error}; going on, as told by --force")
    will = "would write" if options.dry_run else "writing"
    print(f"{will} {image.deadman_version or image.path.name}, {len(image.content)} bytes:")
    print(f"  {shlex.join(firmware_flash.avrdude_command(device, image))}", flush=True)
    if options.dry_run:
        return
    firmware_flash.write(device, image)
    print(f"{device}: firmware {firmware_flash.check_flashed(device, image)}")


@dataclass(frozen=True, slots=True, kw_only=True)
class SetupCardOptions:
    """What `setup-card` takes."""

    boot: Path = argument("Where the card's boot partition is mounted.", metavar="DIR")
    robot: str = option(..., "Its robot_id, and its host name if no --host is given.", "--robot")
    release: Path = option(
        ..., "What `make dist` has made for its system.", "--release", metavar="RELEASE.tar"
    )
    hosts: list[str] | None = hosts_option()
    camera: str = option(
        "",
        'source of [camera]: "picamera2" (the default), /dev/video0, an address.',
        "--camera",
    )
    config: Path | None = option(
        None, "A configuration to use in place of the release's.", "--config", metavar="FILE"
    )
    release_key: list[str] | None = option(
        None,
        "Name of a key of yours whose releases it shall take; may be repeated.",
        "--release-key",
        metavar="KEY",
    )


@with_options
def setup_card(options: SetupCardOptions) -> None:
    """Let a Raspberry Pi set itself up at its first boot, without keyboard and screen.

    Write the card by Raspberry Pi Imager, with host name, user, Wi-Fi and SSH as you like, mount
    its first partition and run this before the Pi starts for the first time. The robot is
    enrolled, trusts your keys for models, and does not move before `workstation run`.

    Example: `workstation setup-card /media/rosa/bootfs --robot mbot-1 --release RELEASE.tar`
    """
    from mbot_protocol.files.text_file import read_text
    from mbot_workstation.fleet.enrolment.membership import Enrolment
    from mbot_workstation.fleet.releases.boot_card import (
        PI_CAMERA,
        CardContent,
        check_boot_partition,
        configured,
        own_configuration,
        prepare,
    )
    from mbot_workstation.fleet.releases.send_release import check_release_file

    check_boot_partition(options.boot)
    manifest = check_release_file(options.release).manifest
    keys, release_keys = _keys(options.release_key or [])
    text = read_text(options.config) if options.config else own_configuration(options.release)
    configuration = configured(text, options.robot, keys, release_keys, options.camera)
    hand_overs = Enrolment().robot(options.robot, options.hosts or ())
    robot = next(h for h in hand_overs if h.is_for_robot(options.robot))
    content = CardContent(
        options.release,
        configuration,
        robot.path.read_bytes(),
        pi_camera=options.camera in ("", PI_CAMERA),
    )
    hooked = prepare(options.boot, content)
    print(
        f"{options.robot}: {manifest.version} for {manifest.system} on {manifest.architecture}; "
        f"{hooked} on the card starts it\n"
        "Unmount the card and start the Pi with it; it takes some minutes. mbot-set-up.log on the\n"
        "card's boot partition says what became of it; until then a key of the robot lies there.\n"
        f"Then: workstation robots --robot {options.robot}"
    )


def _keys(release_keys: list[str]) -> tuple[list[str], list[str]]:
    """Lines for [trust]: for models, for releases."""
    from mbot_workstation.fleet.models.key_folder import KeyFolder

    known = {key.name: key.line for key in KeyFolder().public_keys()}
    if not known:
        raise ConfigurationError(
            "the robot would take models from nobody: `workstation keys new` makes a key"
        )
    if missing := [name for name in release_keys if name not in known]:
        raise ConfigurationError(f"there is no key {missing[0]!r}, only {', '.join(known)}")
    models = [line for name, line in known.items() if name not in release_keys]
    return models or list(known.values()), [known[name] for name in release_keys]


@dataclass(frozen=True, slots=True, kw_only=True)
class UpdateOptions(LinkOptions):
    """What `update` takes."""

    release: Path = argument("What `make dist` has made.", metavar="RELEASE.tar")
    as_json: bool = json_option()


@dataclass(frozen=True, slots=True)
class UpdateOutcome:
    """What became of a release on a robot: "installed", or what it did instead and why."""

    robot_id: str
    version: str
    outcome: str
    detail: str


@with_options
def update(options: UpdateOptions) -> Answer:
    """Send a release of the daemon to a robot and wait until it runs there.

    The robot takes releases signed by a key in its `[trust] release_keys`, while it is not armed.
    It builds the release beside the one that runs, restarts with it, and goes back by itself if
    that is not READY in time or sees or reaches less than before. `mbot-agent rollback` there goes
    back later.

    Example: `workstation update mbot-agent-0.1.0.tar --robot mbot-1`
    """
    from mbot_workstation.fleet.releases.send_release import check_release_file

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
    outcome = UpdateOutcome(name, version, found.phase, detail)
    if found.phase == "installed":
        return Answer(outcome, [f"{name} now runs {version}"])
    words = f"{name} does not run {version}: {found.phase}: {detail}"
    return Answer(outcome, error=RefusedError(words))


def _update_with_bar(link: "RobotLink", release: "CheckedRelease") -> "ReleaseUpdate":
    from mbot_workstation.fleet.releases.send_release import send, wait_for_outcome

    with transfer_bar() as progress:
        task = progress.add_task(f"sending to {link.robot_id}", total=release.size_bytes)
        push_id = send(link, release, lambda sent, _: progress.update(task, completed=sent))

        def show(phase: str) -> None:
            progress.update(task, description=f"{link.robot_id} is {phase} it")

        show("checking")
        return wait_for_outcome(link, push_id, show)
