"""Which of this workstation's keys signs a push: one that the robot trusts."""

from collections.abc import Callable

from mbot_protocol.errors import ConfigurationError, RefusedError
from mbot_protocol.signing.public_key import PublicKey
from mbot_protocol.v1.messages_pb2 import Status
from mbot_workstation.fleet.models.key_folder import KeyFolder
from mbot_workstation.fleet.models.signing_key import SigningKey
from mbot_workstation.fleet.models.trusting_configuration import CONFIGURATION

ChooseKey = Callable[[Status], SigningKey | None]
"""Given what a robot says of itself, the key to sign with; None: send the model unsigned.

Raises RefusedError where no key of ours would do.
"""


def chooser(folder: KeyFolder, wanted: str, ask_passphrase: Callable[[str], str]) -> ChooseKey:
    """Choose among the keys in a folder.

    Args:
        folder: where they are.
        wanted: the name of one to use whatever the robot says; empty: the first trusted one.
        ask_passphrase: as `KeyFolder.load`.

    """

    def choose(status: Status) -> SigningKey | None:
        trusted = trusted_keys(status)
        if wanted:
            key = folder.public_key(wanted)
            if key.raw not in trusted:
                raise RefusedError(_untrusted(status.robot_id, [key]))
            return folder.load(wanted, ask_passphrase)
        own = folder.public_keys()
        for key in own:
            if key.raw in trusted:
                return folder.load(key.name, ask_passphrase)
        if status.accepts_unsigned_models:
            return None
        if own:
            raise RefusedError(_untrusted(status.robot_id, own))
        raise RefusedError(
            f"robot {status.robot_id} takes signed models only and there is no signing key here: "
            "make one with `workstation keys new`, which says how the robot learns of it"
        )

    return choose


def trusted_keys(status: Status) -> set[bytes]:
    """The keys a robot says it trusts; lines that are none are left out."""
    found: set[bytes] = set()
    for line in status.trusted_keys:
        try:
            found.add(PublicKey.parse(line).raw)
        except ConfigurationError:
            continue
    return found


def _untrusted(robot_id: str, keys: list[PublicKey]) -> str:
    names = " or ".join(repr(key.name) for key in keys)
    return (
        f"robot {robot_id} does not trust your key {names}: where it was enrolled, `workstation "
        f"enroll {robot_id}` sends that workstation's keys along, and with `--person NAME --right "
        f'push` one made for somebody else; or put the line "{keys[0].line}" into [trust] keys of '
        f"its configuration ({CONFIGURATION}) and restart mbot-agent there"
    )
