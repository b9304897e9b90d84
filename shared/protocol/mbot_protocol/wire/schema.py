"""Reading a message off the wire: is it whole, and is it of a schema this software knows?"""

from typing import Protocol, TypeVar

from google.protobuf.message import DecodeError, Message

from mbot_protocol.errors import MbotError, NewerSchemaError

SCHEMA_VERSION = 1
"""Raised when an old reader would misunderstand a message; a new optional field needs no raise."""


class MalformedMessageError(MbotError):
    """Bytes that are not the message they should be."""

    exit_code = 5


class _Versioned(Protocol):
    schema_version: int


M = TypeVar("M", bound=Message)


def decode(message_type: type[M], data: bytes, sender: str) -> M:
    """Parse one versioned message.

    Args:
        message_type: the generated class; it has a field `schema_version`.
        data: its bytes.
        sender: who sent it, for the error text: "robot mbot-1", "the workstation".

    Raises:
        MalformedMessageError: the bytes do not parse, or carry no schema version.
        NewerSchemaError: the sender speaks a newer schema.

    """
    name = message_type.DESCRIPTOR.name
    message = message_type()
    try:
        message.ParseFromString(data)
    except DecodeError:
        raise MalformedMessageError(
            f"{sender} sent {len(data)} bytes that are no {name}; is it an mbot-agent at all?"
        ) from None
    version = version_of(message)
    if version > SCHEMA_VERSION:
        raise NewerSchemaError(
            f"{sender} speaks schema {version}, this software knows up to {SCHEMA_VERSION}: "
            "upgrade this side"
        )
    if version == 0:
        raise MalformedMessageError(f"{sender} sent a {name} without a schema version")
    return message


def version_of(message: Message) -> int:
    """The message's schema version; 0 if it has none."""
    versioned: _Versioned = message  # pyright: ignore[reportAssignmentType]
    return versioned.schema_version
