"""`workstation flash`: a firmware onto the board."""

from pathlib import Path
from typing import Annotated

import typer

OURS = Path("out/firmware/mbot-deadman.hex")


def flash(
    *,
    port: Annotated[
        str | None,
        typer.Option(metavar="DEVICE", help="The board's port; the only CH340 on USB otherwise."),
    ] = None,
    image_path: Annotated[
        Path,
        typer.Option("--hex", metavar="FILE", help="Another firmware, such as the stock one."),
    ] = OURS,
    force: Annotated[
        bool,
        typer.Option("--force", help="Write even if the board does not answer as an mCore does."),
    ] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Check everything, say what would be done.")
    ] = False,
) -> None:
    """Write the firmware with a dead man's switch onto an mCore board on this machine's USB.

    `make firmware` makes it. Lift the wheels off the ground: opening the port resets the board.

    Examples:

    - `workstation flash --dry-run`
    - `workstation flash --hex stock.hex` goes back to another firmware
    """
    import shlex

    from mbot_protocol.errors import RefusedError
    from mbot_workstation.firmware import flashing as firmware_flash

    image = firmware_flash.read_image(image_path)
    firmware_flash.need_avrdude()
    device = firmware_flash.find_port(port)
    try:
        version = firmware_flash.ask_version(device)
        print(f"{device}: firmware {version}")
        if not (force or firmware_flash.is_mcore(version)):
            raise RefusedError(
                f"{version!r} on {device} is no mCore firmware known here; --force writes all the "
                "same"
            )
    except firmware_flash.NoAnswerError as error:
        if not force:
            raise firmware_flash.NoAnswerError(f"{error}; --force writes all the same") from None
        print(f"{error}; going on, as told by --force")
    will = "would write" if dry_run else "writing"
    print(f"{will} {image.deadman_version or image.path.name}, {len(image.content)} bytes:")
    print(f"  {shlex.join(firmware_flash.avrdude_command(device, image))}", flush=True)
    if dry_run:
        return
    firmware_flash.write(device, image)
    print(f"{device}: firmware {firmware_flash.check_flashed(device, image)}")
