"""A workstation that is gone in the middle of a push: dying_push.py ADDRESS MODEL SECRET."""

import os
import signal
import sys
from pathlib import Path

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.fleet.models.push import push
from mbot_workstation.fleet.models.signing_key import SigningKey


def _die(_sent: int, _all: int) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


if __name__ == "__main__":
    key = SigningKey(Ed25519PrivateKey.from_private_bytes(bytes.fromhex(sys.argv[3])), "test")
    with RobotLink(sys.argv[1]) as link:
        push(link, Path(sys.argv[2]), lambda _: key, _die)
