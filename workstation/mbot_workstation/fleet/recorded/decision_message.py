"""A decision's bytes, as they stand in recordings of whatever origin."""

from google.protobuf.message import DecodeError

from mbot_protocol.v1.messages_pb2 import Decision

MOST_BYTES = 65_536
"""Three hundred times one without faults."""

MOST_TOLD = 64
"""Faults and notices: the daemon knows some 20, and tells of each once. An empty one has 2 bytes,
and thirty times as many as an object.
"""


def read_decision(data: bytes) -> Decision:
    """Read it.

    Raises:
        DecodeError: it is none, or none that a robot could have sent.

    """
    if len(data) > MOST_BYTES:
        raise DecodeError(f"{len(data)} bytes, expected at most {MOST_BYTES}")
    decision = Decision.FromString(data)
    if (told := len(decision.faults) + len(decision.notices)) > MOST_TOLD:
        raise DecodeError(f"{told} faults and notices, expected at most {MOST_TOLD}")
    return decision
