"""`workstation flash`: a firmware onto the board."""

from dataclasses import dataclass
from pathlib import Path

from mbot_workstation.cli.options import option, with_options

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

    from mbot_protocol.errors import RefusedError
    from mbot_workstation.fleet.firmware import flashing as firmware_flash

    image = firmware_flash.read_image(options.image_path)
    firmware_flash.need_avrdude()
    device = firmware_flash.find_port(options.port)
    try:
        version = firmware_flash.ask_version(device)
        print(f"{device}: firmware {version}")
        if not (options.force or firmware_flash.is_mcore(version)):
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
