"""Where published policies lie: a folder here, or the same folder behind a web address.

    index.json            {"policies": ["red-cube"]}
    red-cube/card.json    the card, and card.sig its signature
    red-cube/model.onnx

Nothing that is read is believed: names lead nowhere else, sizes are bounded, no link is followed.
"""

import hashlib
import os
import re
import stat
import time
import urllib.error
import urllib.request
from http.client import HTTPException
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import urlsplit

import msgspec

from mbot_protocol.errors import ConfigurationError, RefusedError, UnreachableError
from mbot_protocol.files import atomic_file
from mbot_protocol.policy.policy_contract import LARGEST_MODEL_BYTES
from mbot_workstation.fleet.models.check import CheckedModel, check_model_data
from mbot_workstation.fleet.models.signing_key import SigningKey
from mbot_workstation.fleet.policies.policy_card import (
    LARGEST_SIGNATURE_BYTES,
    NAME_PATTERN,
    POLICY,
    PolicyCard,
    SignedCard,
    read_card,
    sign_card,
)
from mbot_workstation.wording import one_line

INDEX, CARD, SIGNATURE, MODEL_FILE = "index.json", "card.json", "card.sig", "model.onnx"
MOST_POLICIES = 500
LARGEST_INDEX_BYTES = 64 * 1024

MOST_REDIRECTS = 3
ANSWER_WITHIN_S = 15.0
ALL_WITHIN_S = 120.0


class PolicyIndex(msgspec.Struct, frozen=True):
    """The names in a shelf; signed by nobody, and nothing but names."""

    policies: list[str]


class Shelf(Protocol):
    """Where files are read from."""

    def read(self, name: str, most_bytes: int) -> bytes:
        """A file; raises RefusedError if it is too large or no plain file, UnreachableError and
        ConfigurationError if it can't be read.
        """
        ...


class FolderShelf:
    """A folder on this machine."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def read(self, name: str, most_bytes: int) -> bytes:
        """No link is followed below the folder, and nothing but plain files are read."""
        where = self._folder / name
        flags = os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC
        try:
            folder = os.open(self._folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
            try:
                *inner, last = name.split("/")
                for one in inner:
                    above, folder = folder, os.open(one, flags | os.O_DIRECTORY, dir_fd=folder)
                    os.close(above)
                file = os.open(last, flags | os.O_NONBLOCK, dir_fd=folder)
            finally:
                os.close(folder)
            with os.fdopen(file, "rb") as opened:
                if not stat.S_ISREG(os.fstat(file).st_mode):
                    raise RefusedError(f"{where} is no plain file")
                return _at_most(opened.read(most_bytes + 1), most_bytes, str(where))
        except OSError as error:
            raise ConfigurationError(f"can't read {where}: {error.strerror}") from None


class FewRedirects(urllib.request.HTTPRedirectHandler):
    """A few, and never from https to http, nor to a file."""

    max_redirections = MOST_REDIRECTS

    def redirect_request(
        self, req: Any, fp: Any, code: int, msg: str, headers: Any, newurl: str
    ) -> Any:
        """None of those that an address of a web server would not name."""
        before, after = urlsplit(req.full_url).scheme, urlsplit(newurl).scheme
        if after != before and (before, after) != ("http", "https"):
            raise RefusedError(f"{req.full_url} leads to {one_line(newurl)}, which is not followed")
        return super().redirect_request(req, fp, code, msg, headers, newurl)


class WebShelf:
    """The same behind http:// or https://."""

    def __init__(self, address: str) -> None:
        """Raises ConfigurationError if the address is none of a folder."""
        parts = urlsplit(address)
        if not parts.hostname or parts.query or parts.fragment or "@" in parts.netloc:
            raise ConfigurationError(
                "expected the address of a folder such as https://HOST/policies, without a login, "
                "? and #"
            )
        self._address = address.rstrip("/")
        self._opener = urllib.request.build_opener(FewRedirects)

    def read(self, name: str, most_bytes: int) -> bytes:
        """As much as is allowed, within two minutes."""
        address = f"{self._address}/{name}"
        gathered, until_s = bytearray(), time.monotonic() + ALL_WITHIN_S
        try:
            with self._opener.open(address, timeout=ANSWER_WITHIN_S) as reply:
                while piece := reply.read1(64 * 1024):
                    gathered += piece
                    _at_most(gathered, most_bytes, address)
                    if time.monotonic() > until_s:
                        raise UnreachableError(f"{address} takes longer than {ALL_WITHIN_S:g} s")
        except urllib.error.HTTPError as error:
            raise UnreachableError(f"{address}: {error.code} {one_line(error.reason)}") from None
        except (OSError, HTTPException, ValueError) as error:
            why = getattr(error, "reason", error)
            raise UnreachableError(f"{address} can't be read: {one_line(str(why))}") from None
        return bytes(gathered)


def open_shelf(place: str) -> Shelf:
    """A folder, or an address; raises ConfigurationError if it is neither."""
    if place.startswith(("http://", "https://")):
        return WebShelf(place)
    if not (folder := Path(place)).is_dir():
        raise ConfigurationError(
            f"{place} is no folder, and no address such as https://HOST/policies"
        )
    return FolderShelf(folder)


def names_on(shelf: Shelf) -> list[str]:
    """The names of its policies, those that are none left out; raises as `Shelf.read`."""
    data = shelf.read(INDEX, LARGEST_INDEX_BYTES)
    try:
        named = msgspec.json.decode(data, type=PolicyIndex).policies
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise RefusedError(f"its {INDEX} is unusable: {one_line(str(error))}") from None
    return [name for name in named if re.fullmatch(NAME_PATTERN, name)][:MOST_POLICIES]


def card_on(shelf: Shelf, name: str) -> SignedCard:
    """A policy's card, its signature good; raises as `Shelf.read` and `read_card`."""
    if not re.fullmatch(NAME_PATTERN, name):
        raise ConfigurationError(f"{name!r} is no policy's name: a-z, 0-9, - and _")
    data = shelf.read(f"{name}/{CARD}", POLICY.largest_bytes)
    return read_card(data, shelf.read(f"{name}/{SIGNATURE}", LARGEST_SIGNATURE_BYTES), name)


def model_on(shelf: Shelf, card: PolicyCard) -> CheckedModel:
    """The model that a card names.

    Raises:
        RefusedError: it is another file.
        ContractError: no robot would take it.

    """
    data = shelf.read(f"{card.name}/{MODEL_FILE}", min(card.size_bytes, LARGEST_MODEL_BYTES))
    if len(data) != card.size_bytes or hashlib.sha256(data).hexdigest() != card.sha256:
        raise RefusedError(f"{card.name}: its model is not the one that the card was signed for")
    return check_model_data(data, card.name)


def put_on(folder: Path, card: PolicyCard, model: bytes, key: SigningKey) -> Path:
    """Write a policy into a folder, in place of one of its name; the folder of it.

    Raises:
        ConfigurationError: it can't be written.

    """
    home = folder / card.name
    data, signature = sign_card(card, key)
    read_card(data, signature, card.name)  # as everybody else will
    readme = "\n".join([f"# {card.name}", "", "```", *card.lines(), "```", ""])
    try:
        home.mkdir(parents=True, exist_ok=True)
        atomic_file.replace(home / MODEL_FILE, model)
        atomic_file.replace(home / CARD, data)
        atomic_file.replace(home / SIGNATURE, signature)
        atomic_file.replace(home / "README.md", readme.encode())
        names = sorted(path.parent.name for path in folder.glob(f"*/{CARD}"))
        atomic_file.replace(folder / INDEX, msgspec.json.encode(PolicyIndex(names)) + b"\n")
    except OSError as error:
        raise ConfigurationError(f"can't write {folder}: {error.strerror}") from None
    return home


def _at_most(data: Any, most_bytes: int, where: str) -> Any:
    if len(data) > most_bytes:
        raise RefusedError(f"{where} has more than the {most_bytes} bytes expected")
    return data
