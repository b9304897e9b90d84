"""The numbers that senders have given their commands: each is obeyed once, and in order."""

from mbot_protocol.errors import RefusedError

MOST_SENDERS = 64
"""The one that has been silent for longest is forgotten. Its commands have expired long before 63
others have come: none is good for more than 2 s."""


class SenderNumbers:
    """The last number of each sender. For one thread."""

    def __init__(self) -> None:
        self._last: dict[int, int] = {}  # in the order of their last command

    def take(self, sender_id: int, number: int) -> None:
        """Note a command.

        Raises:
            RefusedError: it has come before, or a later one of the same sender has.

        """
        last = self._last.pop(sender_id, 0)
        self._last[sender_id] = max(last, number)
        if number <= last:
            raise RefusedError(
                f"command {number} of this sender comes after {last}: it was repeated or overtaken"
            )
        if len(self._last) > MOST_SENDERS:
            del self._last[next(iter(self._last))]
