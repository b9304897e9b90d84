"""What goes between `workstation replay` and the daemon's own decide, a process beside it.

Messages with their length before them: the workstation sends a step for each recorded decision, and
the daemon's program answers each. It begins with a `ReplayGreeting`, or with one line on stderr.
"""

import struct
from typing import IO, TypeVar

import msgspec

_LENGTH = struct.Struct("<I")
LARGEST_BYTES = 1 << 20


class ReplayGreeting(msgspec.Struct, frozen=True, array_like=True):
    """Who decides: the model's digest and name, what computes, and what the model wants to see.

    Attributes:
        view_deg: its field of view, horizontal and vertical; 0 from a program that does not tell.

    """

    sha256: str
    name: str
    processor: str
    view_deg: tuple[float, float] = (0.0, 0.0)


class ReplayStep(msgspec.Struct, frozen=True, array_like=True):
    """One decision to be made again.

    Attributes:
        observation: 64 x 64 x 3 bytes, RGB, as the policy saw it.
        began_anew: its memory was zero.
        told: what it was told that the wheels did before, left and right in [-1, 1].
        memory: go on with this, float32, little endian; empty: with what it remembers itself.

    """

    observation: bytes
    began_anew: bool
    told: tuple[float, float]
    memory: bytes = b""


class ReplayAnswer(msgspec.Struct, frozen=True, array_like=True):
    """What the daemon would do.

    Attributes:
        action: left and right wheel, not yet clipped.
        steps: the same in motor steps.
        memory: what it went on with; empty: nothing.
        failure: why there is no action; empty: there is one.

    """

    action: tuple[float, float] = (0.0, 0.0)
    steps: tuple[int, int] = (0, 0)
    memory: bytes = b""
    failure: str = ""


S = TypeVar("S", bound=msgspec.Struct)


def send(stream: IO[bytes], message: msgspec.Struct) -> None:
    """Write one message and hand it on."""
    data = msgspec.msgpack.encode(message)
    stream.write(_LENGTH.pack(len(data)) + data)
    stream.flush()


def receive(stream: IO[bytes], kind: type[S]) -> S | None:
    """The next message; None where the other side has ended.

    Raises:
        ValueError: it is not of this kind, or was cut off.

    """
    head = stream.read(_LENGTH.size)
    if not head:
        return None
    length: int = _LENGTH.unpack(head)[0] if len(head) == _LENGTH.size else LARGEST_BYTES + 1
    data = stream.read(length) if length <= LARGEST_BYTES else b""
    if len(data) != length:
        raise ValueError(f"a {kind.__name__} was cut off")
    return msgspec.msgpack.decode(data, type=kind)
