"""How a card's first boot comes to call us, beside what Raspberry Pi Imager has written there.

Text in, text out. Three ways, of which a card has one: Imager's script `firstrun.sh` (Bookworm),
the `user-data` of cloud-init (Trixie), or neither: then the kernel's command line, which is what
starts firstrun.sh as well.
"""

import re
from typing import NamedTuple

from mbot_protocol.errors import ConfigurationError

FOLDER = "mbot"
SCRIPT = f"{FOLDER}/first-boot.sh"
MOUNTED = "/boot/firmware"
"""Where Bookworm and Trixie have the boot partition."""

_SHELL_LINE = f'sh "$(dirname "$0")/{SCRIPT}"  # added by workstation setup-card\n'
_CLOUD_ITEM = f"- [sh, {MOUNTED}/{SCRIPT}, now]  # added by workstation setup-card"
_KERNEL_WORDS = (
    f"systemd.run={MOUNTED}/{SCRIPT} systemd.run_success_action=reboot "
    "systemd.unit=kernel-command-line.target"
)


class Hook(NamedTuple):
    """A file of the boot partition, and what it shall hold."""

    name: str
    text: str


def hook(cmdline: str, firstrun: str | None, user_data: str | None) -> Hook:
    """The one file to change.

    Args:
        cmdline: of cmdline.txt.
        firstrun: of firstrun.sh; None: there is none.
        user_data: of user-data; None: there is none.

    Raises:
        ConfigurationError: what is there can't be added to.

    """
    called = re.search(r"(?:^| )systemd\.run=(\S+)", cmdline.strip())
    if called and called[1].endswith("/firstrun.sh"):
        if firstrun is None:
            raise ConfigurationError(
                "cmdline.txt starts firstrun.sh, which is not there: write the card again"
            )
        return Hook("firstrun.sh", _in_firstrun(firstrun))
    if user_data is not None:
        return Hook("user-data", _in_user_data(user_data))
    if called and not called[1].endswith(SCRIPT):
        raise ConfigurationError(f"cmdline.txt already runs {called[1]} at the first boot")
    return Hook("cmdline.txt", cmdline if called else _in_cmdline(cmdline))


def _in_firstrun(text: str) -> str:
    if _SHELL_LINE in text:
        return text
    first, newline, rest = text.partition("\n")
    if not first.startswith("#!") or not newline:
        raise ConfigurationError("firstrun.sh does not begin with #!: write the card again")
    return f"{first}\n{_SHELL_LINE}{rest}"


def _in_user_data(text: str) -> str:
    if _CLOUD_ITEM in text:
        return text
    if not text.startswith("#cloud-config"):
        raise ConfigurationError(
            "user-data does not begin with #cloud-config: write the card again"
        )
    lines = text.rstrip("\n").split("\n")
    found = [number for number, line in enumerate(lines) if line.startswith("runcmd:")]
    if not found:
        return "\n".join([*lines, "runcmd:", _CLOUD_ITEM, ""])
    if len(found) > 1 or not re.fullmatch(r"runcmd:\s*(#.*)?", lines[found[0]]):
        raise ConfigurationError(
            "user-data has a runcmd that is not a list of lines: write it as one"
        )
    after = lines[found[0] + 1 :]
    item = next((line for line in after if line.strip() and not line.lstrip().startswith("#")), "")
    indent = re.match(r"( *)- ", item)
    lines.insert(found[0] + 1, (indent[1] if indent else "") + _CLOUD_ITEM)
    return "\n".join([*lines, ""])


def _in_cmdline(text: str) -> str:
    return f"{text.strip()} {_KERNEL_WORDS}\n"
