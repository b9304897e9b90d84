"""`workstation setup-card`: a robot's card, before its first start."""

from dataclasses import dataclass
from pathlib import Path

from mbot_workstation.cli.options import argument, option, with_options


@dataclass(frozen=True, slots=True, kw_only=True)
class SetupCardOptions:
    """What `setup-card` takes."""

    boot: Path = argument("Where the card's boot partition is mounted.", metavar="DIR")
    robot: str = option(..., "Its robot_id, and its host name if no --host is given.", "--robot")
    release: Path = option(
        ..., "What `make dist` has made for its system.", "--release", metavar="RELEASE.tar"
    )
    hosts: list[str] | None = option(
        None,
        "Name or address it is reached by, the best one first; may be repeated. "
        "ROBOT.local if never given.",
        "--host",
        metavar="NAME",
    )
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
    enrolled, trusts your keys for models, and stands until `workstation run`.

    Example: `workstation setup-card /media/rosa/bootfs --robot mbot-1 --release RELEASE.tar`
    """
    from mbot_protocol.files.text_file import read_text
    from mbot_protocol.wire.access_rules import Kind
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
    robot = next(h for h in hand_overs if (h.kind, h.name) == (Kind.ROBOT, options.robot))
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
    from mbot_protocol.errors import ConfigurationError
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
