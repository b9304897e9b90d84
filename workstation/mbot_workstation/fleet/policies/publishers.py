"""Whose published policies this workstation's user takes: keys that were looked at once."""

import os
from collections.abc import Callable
from pathlib import Path

from mbot_protocol.errors import ConfigurationError, RefusedError
from mbot_protocol.files import atomic_file
from mbot_protocol.files.text_file import text_if_any
from mbot_protocol.signing.public_key import PublicKey
from mbot_workstation.fleet.models.key_folder import KeyFolder
from mbot_workstation.fleet.policies.policy_card import SignedCard, fingerprint
from mbot_workstation.wording import typed


def publishers_file() -> Path:
    """`mbot-agent/publishers` in the user's configuration: a public line each."""
    base = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    return Path(base) / "mbot-agent" / "publishers"


class Publishers:
    """The file, and this user's own keys."""

    def __init__(self, path: Path | None = None, own: KeyFolder | None = None) -> None:
        self._path, self._own = path or publishers_file(), own or KeyFolder()

    def knows(self, key: PublicKey) -> bool:
        """Whether it is one's own or was looked at before; raises ConfigurationError."""
        return key.raw in {one.raw for one in (*self._own.public_keys(), *self._known())}

    def admit(self, signed: SignedCard, given: str, ask: Callable[[str], bool]) -> None:
        """Take a card's key: known, named by its fingerprint, or looked at now.

        Args:
            signed: the card.
            given: the fingerprint that a person has typed; empty: none.
            ask: called with a question about a key that is not known.

        Raises:
            RefusedError: it is another key than the one that was named, or nobody takes it.
            ConfigurationError: the file can't be read or written.

        """
        marks, name = fingerprint(signed.key), signed.card.name
        if given and given != marks:
            raise RefusedError(f"{name} is signed by {marks}, not by {given}")
        if self.knows(signed.key):
            return
        if not given and not ask(
            f"{name} is signed by {marks}, not seen before. Trust it from now on?"
        ):
            raise RefusedError(
                f"{name} is signed by a key that is not trusted here: ask its publisher whether "
                f"its fingerprint is {marks}, then --trust {typed(marks)}"
            )
        line = PublicKey(signed.key.raw, _as_key_name(signed.card.publisher)).line
        lines = [one.line for one in self._known()] + [line]
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            atomic_file.replace(self._path, ("\n".join(lines) + "\n").encode(), mode=0o600)
        except OSError as error:
            raise ConfigurationError(f"can't write {self._path}: {error.strerror}") from None

    def _known(self) -> list[PublicKey]:
        text = text_if_any(self._path) or ""
        return [PublicKey.parse(line) for line in text.splitlines() if line.strip()]


def _as_key_name(publisher: str) -> str:
    kept = "".join(c for c in publisher if c.isascii() and (c.isalnum() or c in "_.@-"))
    return kept.lstrip("_.@-")[:48] or "publisher"
