"""Models on disk: one file each, named by its digest, and one that says which is active.

Every file is replaced whole or not at all, the model before what names it: after a power cut at
any moment the active model is a whole one, the old or the new.
"""

import errno
import hashlib
import logging
import shutil
from collections.abc import Callable
from pathlib import Path

import msgspec

from mbot_agent.models.activation import Activation
from mbot_protocol.errors import ContractError, RefusedError
from mbot_protocol.files import atomic_file
from mbot_protocol.signing.envelope import Envelope

log = logging.getLogger(__name__)

_DIGEST_DIGITS = 64


class Label(msgspec.Struct, frozen=True):
    """What is kept beside a model: listing must not load every one.

    Attributes:
        name, decision_rate_hz: what it says of itself.
        signed: the manifest it was pushed with, as `Envelope.to_text`; empty: none.

    """

    name: str = ""
    decision_rate_hz: float = 0.0
    signed: str = ""

    @property
    def manifest(self) -> Envelope | None:
        """The manifest it was pushed with; None if it was pushed without.

        Raises:
            RefusedError: it is damaged.

        """
        return Envelope.from_text(self.signed) if self.signed else None


class StoredModel(msgspec.Struct, frozen=True):
    """One model in the store."""

    sha256: str
    size_bytes: int
    stored_unix_time_ns: int
    label: Label


class ModelDirectory:
    """The directory of models. Only one thread at a time may change it.

    Attributes:
        say: takes what is worth a line in the log: level, line, values. Whoever calls under a lock
            puts something here that waits.

    """

    def __init__(self, directory: Path, keep: int) -> None:
        """Use `directory`, made if missing; keep at most `keep` models.

        Raises:
            RefusedError: it cannot be made or written.

        """
        self._directory = directory
        self._keep = keep
        self.say: Callable[..., None] = log.log
        try:
            directory.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RefusedError(
                f"cannot use {directory} for models: {error.strerror}; set models.directory"
            ) from None

    def sweep(self) -> None:
        """Delete what a power cut has left behind; for the daemon's start, before it writes."""
        for path in self._directory.glob(f"*{atomic_file.TEMPORARY}"):
            atomic_file.remove(path)
        for path in self._directory.glob("*.json"):
            if len(path.stem) == _DIGEST_DIGITS and not self._path(path.stem).exists():
                atomic_file.remove(path)

    @property
    def activation(self) -> Activation:
        """Which model is active; none where the file is missing, unreadable or damaged."""
        try:
            return self._read_activation()
        except OSError as error:
            self.say(logging.ERROR, "which model is active can't be read: %s", error.strerror)
            return Activation()

    def models(self) -> list[StoredModel]:
        """All stored models, newest first.

        Raises:
            RefusedError: the directory can't be read.

        """
        try:
            found: list[StoredModel] = []
            for path in self._directory.glob("*.onnx"):
                status = path.stat()
                label = self.label(path.stem)
                found.append(StoredModel(path.stem, status.st_size, status.st_mtime_ns, label))
        except OSError as error:
            raise RefusedError(f"cannot read the stored models: {error.strerror}") from None
        return sorted(found, key=lambda model: model.stored_unix_time_ns, reverse=True)

    def no_room(self, needed_bytes: int, free_bytes: int) -> str:
        """Why a model does not fit on the disk, and what can be removed there."""
        stored = self.models()
        stored_bytes = sum(model.size_bytes for model in stored)
        return (
            f"the robot's disk is full: it takes {needed_bytes / 1e6:.1f} MB in {self._directory}, "
            f"{free_bytes / 1e6:.1f} MB are free; shorten its log (`sudo journalctl "
            f"--vacuum-size=50M` there), or keep fewer than the {len(stored)} models stored, "
            f"{stored_bytes / 1e6:.1f} MB (models.keep in its configuration)"
        )

    def find(self, prefix: str) -> str:
        """The digest of the one stored model beginning with `prefix` (8 digits at least).

        Raises:
            RefusedError: none or several fit.

        """
        fitting = [m.sha256 for m in self.models() if m.sha256.startswith(prefix.lower())]
        if len(prefix) < 8 or len(fitting) != 1:
            raise RefusedError(
                f"{len(fitting)} stored models begin with {prefix!r}: give 8 or more digits of one "
                "that `workstation models` lists"
            )
        return fitting[0]

    def read(self, sha256: str) -> bytes:
        """A stored model, verified against its digest.

        Raises:
            ContractError: missing, unreadable or damaged.

        """
        path = self._path(sha256)
        try:
            data = path.read_bytes()
        except OSError as error:
            raise ContractError(f"cannot read the model {path}: {error.strerror}") from None
        if hashlib.sha256(data).hexdigest() != sha256:
            raise ContractError(f"the model {path} is damaged: push it again")
        return data

    def successors(self, sha256: str) -> list[str]:
        """The stored models to go back to from this one, best first."""
        return [one for one in self.activation.successors(sha256) if self._path(one).is_file()]

    def stored_unix_time_ns(self, sha256: str) -> int:
        """When a model was stored; 0 if that can't be found out."""
        try:
            return self._path(sha256).stat().st_mtime_ns
        except OSError:
            return 0

    def size_bytes(self, sha256: str) -> int:
        """The length of a stored model's file; 0 if that can't be found out."""
        try:
            return self._path(sha256).stat().st_size
        except OSError:
            return 0

    def label(self, sha256: str) -> Label:
        """What is kept beside a model; an empty label if that is missing or damaged."""
        try:
            return msgspec.json.decode(self._label_path(sha256).read_bytes(), type=Label)
        except (OSError, msgspec.DecodeError):
            return Label()

    def add(self, sha256: str, data: bytes, label: Label) -> None:
        """Store a model; the active one does not change.

        Raises:
            RefusedError: the disk refuses it.

        """
        try:
            atomic_file.replace(self._label_path(sha256), msgspec.json.encode(label))
            if not self._is_whole(sha256):
                atomic_file.replace(self._path(sha256), data)
        except OSError as error:
            remedy = ""
            if error.errno == errno.ENOSPC:
                free_bytes = shutil.disk_usage(self._directory).free
                remedy = f"; {self.no_room(len(data), free_bytes)}"
            raise RefusedError(f"cannot store the model: {error.strerror}{remedy}") from None

    def activate(self, sha256: str, in_use: str) -> None:
        """Make a stored model the active one; the one in use becomes the previous one.

        Raises:
            RefusedError: it is not stored, or the disk refuses; the old one stays active.

        """
        if not self._path(sha256).is_file():
            raise RefusedError(f"there is no stored model {sha256[:12]}: push it again")
        self.change(lambda activation: activation.activated(sha256, in_use))
        self._forget_oldest()

    def change(self, step: Callable[[Activation], Activation]) -> None:
        """Replace the activation by what `step` makes of it.

        Raises:
            RefusedError: the disk refuses; nothing has changed.

        """
        try:
            old = self._read_activation()
            new = step(old)
            if new != old:
                atomic_file.replace(self._activation_path, msgspec.json.encode(new))
        except OSError as error:
            raise RefusedError(f"cannot note which model is active: {error.strerror}") from None

    def _read_activation(self) -> Activation:
        try:
            return msgspec.json.decode(self._activation_path.read_bytes(), type=Activation)
        except FileNotFoundError:
            return Activation()
        except (msgspec.DecodeError, UnicodeDecodeError) as error:
            self.say(logging.ERROR, "%s is damaged: %s", self._activation_path, error)
            return Activation()

    def _forget_oldest(self) -> None:
        """Delete what `keep` leaves no room for; never what may yet be gone back to."""
        activation = self.activation
        needed = {activation.active, activation.previous, *self.successors(activation.active)[:1]}
        try:
            stored = self.models()
        except RefusedError as error:
            self.say(logging.WARNING, "no room was made for further models: %s", error)
            return
        spare = [model for model in stored if model.sha256 not in needed]
        room = self._keep - (len(stored) - len(spare))
        for model in spare[max(0, room) :]:
            atomic_file.remove(self._path(model.sha256))
            atomic_file.remove(self._label_path(model.sha256))

    def _is_whole(self, sha256: str) -> bool:
        try:
            return bool(self.read(sha256))
        except ContractError:
            return False

    @property
    def _activation_path(self) -> Path:
        return self._directory / "active.json"

    def _label_path(self, sha256: str) -> Path:
        return self._directory / f"{sha256}.json"

    def _path(self, sha256: str) -> Path:
        return self._directory / f"{sha256}.onnx"
