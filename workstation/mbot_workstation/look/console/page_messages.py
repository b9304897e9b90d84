"""What the page says over its websocket."""

import msgspec

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.fleet.by_hand.hand import HandRepeat

LONGEST_BYTES = 4096


class LetGo(msgspec.Struct, frozen=True, tag_field="do", tag="let-go"):
    """The hand has let go, or the page cannot be sure that it still holds; see `HandRepeat`."""

    press: int


class RunRequest(msgspec.Struct, frozen=True, tag_field="do", tag="run"):
    """Let the policy drive; `seen_stops` as in `HandRepeat`."""

    seen_stops: int


class MarkWrong(msgspec.Struct, frozen=True, tag_field="do", tag="mark"):
    """What the robot has just done was wrong."""


class ListModels(msgspec.Struct, frozen=True, tag_field="do", tag="models"):
    """Which models the robot keeps."""


class GoBack(msgspec.Struct, frozen=True, tag_field="do", tag="roll-back"):
    """Make a kept model active."""

    sha256: str


class ListRecordings(msgspec.Struct, frozen=True, tag_field="do", tag="recordings"):
    """Which drives the robot has recorded."""


PageMessage = HandRepeat | LetGo | RunRequest | MarkWrong | ListModels | GoBack | ListRecordings

_DECODER = msgspec.json.Decoder(PageMessage)


def read_message(text: str) -> PageMessage:
    """One message of the page.

    Raises:
        ConfigurationError: it is none.

    """
    if len(text) > LONGEST_BYTES:
        raise ConfigurationError(f"a message of {len(text)} signs, expected {LONGEST_BYTES}")
    try:
        return _DECODER.decode(text)
    except msgspec.DecodeError as error:
        raise ConfigurationError(f"no message of the console's page: {error}") from None
