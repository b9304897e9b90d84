"""Who may use the console: somebody who was shown its address, from a page that came from it.

Every address begins with a token, so whoever has not seen it gets nothing. The browser is asked two
things beside: which host it believes to talk to (a page of another site can make a name of its own
point to 127.0.0.1: DNS rebinding), and which page a request comes from (any page may post to any
address, or open a websocket there).
"""

import secrets
from collections.abc import Mapping
from urllib.parse import urlsplit

LOOPBACK_NAMES = ("127.0.0.1", "localhost", "::1")
"""Under which a browser reaches this machine, or an SSH tunnel's end on its own."""

_TOKEN_BYTES = 18


def new_token() -> str:
    """24 letters, digits, `-` and `_`; another token for each start."""
    return secrets.token_urlsafe(_TOKEN_BYTES)


class Door:
    """Lets requests in or says why not."""

    def __init__(self, token: str) -> None:
        self._token = token.encode()

    def refusal(self, path: str, headers: Mapping[str, str], *, acts: bool) -> str:
        """Why a request is not let in; empty if it is.

        Args:
            path: of the request: `/TOKEN/...`.
            headers: by lower-case name.
            acts: whether it does more than look: then it must say which page it comes from.

        """
        host = headers.get("host", "")
        if not _is_loopback(host):
            return "this host is none of the console's names; use the address that it printed"
        origin = headers.get("origin")
        if (acts or origin is not None) and origin != f"http://{host}":
            return "the request comes from a page that is not the console's"
        given = path.removeprefix("/").partition("/")[0].encode()
        if not secrets.compare_digest(given, self._token):
            return "the address lacks the console's token; use the one that it printed"
        return ""


def _is_loopback(host: str) -> bool:
    """Whether a Host header names this machine, at any port: a tunnel may have another one."""
    try:
        parts = urlsplit(f"//{host}")
        names_only = parts.netloc == host and "@" not in host and parts.port != 0
        return names_only and parts.hostname in LOOPBACK_NAMES
    except ValueError:
        return False
