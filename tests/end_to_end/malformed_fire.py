"""Somebody who fires malformed messages: `malformed_fire.py ADDRESS ROBOT_ID MESSAGES`.

A process of its own: in the one whose STOP is timed, both would wait for one interpreter, and so
would the board's stand-in. Prints a JSON object, the answers on each key.
"""

import json
import random
import sys

import zenoh

from mbot_protocol.v1.messages_pb2 import Command, PushBegin, PushChunk
from mbot_protocol.wire.keys import TOPICS, Flow
from mbot_workstation.fleet.link.address import parse_address
from mbot_workstation.fleet.link.robot_session import open_session

AT_A_TIME = 12
"""Fewer than the daemon keeps waiting for one service, so that each one is really parsed."""


def malformed(chance: random.Random, robot_id: str) -> bytes:
    """Noise, a message cut short, one with a byte changed, or one of another kind."""
    whole = chance.choice(
        (
            Command(schema_version=1, robot_id=robot_id, session_id=1, expires_monotonic_ns=1),
            PushBegin(schema_version=1, robot_id=robot_id, sha256="0" * 64, size_bytes=100),
            PushChunk(schema_version=1, push_id="x", data=b"x" * 100),
        )
    ).SerializeToString()
    at = chance.randrange(len(whole))
    return chance.choice(
        (
            chance.randbytes(chance.randrange(300)),
            whole[:at],
            whole[:at] + chance.randbytes(1) + whole[at + 1 :],
            b"\xff" * 3000,
            b"",
        )
    )


def fire(
    session: zenoh.Session, key: str, robot_id: str, messages: int, chance: random.Random
) -> int:
    """All malformed messages on one key; how many were answered."""
    answered = 0
    for _ in range(0, messages, AT_A_TIME):
        waiting = [
            session.get(key, payload=malformed(chance, robot_id), timeout=20.0)
            for _ in range(AT_A_TIME)
        ]
        answered += sum(reply.ok is not None for replies in waiting for reply in replies)
    return answered


def main() -> None:
    address, robot_id, messages = sys.argv[1], sys.argv[2], int(sys.argv[3])
    with open_session(parse_address(address), None) as session:
        answered = {
            topic.name: fire(session, topic.key(robot_id), robot_id, messages, random.Random(at))
            for at, topic in enumerate(topic for topic in TOPICS if topic.flow is Flow.QUERY)
        }
    print(json.dumps(answered))


if __name__ == "__main__":
    main()
