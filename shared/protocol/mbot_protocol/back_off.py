"""How long to wait between attempts at something that may come back: ever longer, up to 2 s."""

_WAITS_S = (0.2, 0.5, 1.0, 2.0)
"""A cable that was pulled is back within a second or two; a device that is gone is asked every 2 s,
which costs nothing and finds it again within the 5 s that docs/safety.md promises."""


class BackOff:
    """The waits of one thing that is tried again and again."""

    def __init__(self) -> None:
        self._failures = 0

    def succeeded(self) -> None:
        """It works: the next failure is a first one."""
        self._failures = 0

    def next_s(self) -> float:
        """It has failed once more: seconds to wait before the next attempt."""
        wait_s = _WAITS_S[min(self._failures, len(_WAITS_S) - 1)]
        self._failures += 1
        return wait_s
