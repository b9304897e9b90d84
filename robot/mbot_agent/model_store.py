"""Models on disk: one file each, named by its digest, and a pointer to the active one.

Every write goes to a temporary file first, is synced, and renamed: after a power cut at any
moment the pointer names a whole model, the old one or the new one.
"""

import contextlib
import hashlib
import logging
import os
import time
from pathlib import Path

import msgspec

from mbot_protocol.errors import ContractError, RefusedError

log = logging.getLogger(__name__)


class Pointer(msgspec.Struct, frozen=True):
    """Which models are active and previous, by digest; empty: none."""

    active: str = ""
    previous: str = ""


class Label(msgspec.Struct, frozen=True):
    """What a stored model says of itself, kept beside it: listing must not load every model."""

    name: str = ""
    decision_rate_hz: float = 0.0


class StoredModel(msgspec.Struct, frozen=True):
    """One model in the store."""

    sha256: str
    size_bytes: int
    stored_unix_time_ns: int
    label: Label


class ModelStore:
    """The directory of models. Only one thread at a time may change it."""

    def __init__(self, directory: Path, keep: int) -> None:
        """Use `directory`, made if missing; keep at most `keep` models.

        Raises:
            RefusedError: it cannot be made or written.

        """
        self._directory = directory
        self._keep = keep
        try:
            directory.mkdir(parents=True, exist_ok=True)
            for leftover in directory.glob("*.tmp"):
                leftover.unlink()
        except OSError as error:
            raise RefusedError(
                f"cannot use {directory} for models: {error.strerror}; set models.directory"
            ) from None

    @property
    def pointer(self) -> Pointer:
        """The active and the previous model; empty where there is none or the file is damaged."""
        try:
            return msgspec.json.decode((self._directory / "active.json").read_bytes(), type=Pointer)
        except FileNotFoundError:
            return Pointer()
        except (OSError, msgspec.DecodeError) as error:
            log.error("the pointer to the active model is unreadable: %s", error)
            return Pointer()

    def models(self) -> list[StoredModel]:
        """All stored models, newest first."""
        found: list[StoredModel] = []
        for path in self._directory.glob("*.onnx"):
            status = path.stat()
            label = self._label(path.stem)
            found.append(StoredModel(path.stem, status.st_size, status.st_mtime_ns, label))
        return sorted(found, key=lambda model: model.stored_unix_time_ns, reverse=True)

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

    def add(self, sha256: str, data: bytes, label: Label) -> None:
        """Store a model; the active one does not change.

        Raises:
            RefusedError: the disk refuses it.

        """
        try:
            self._write(self._label_path(sha256), msgspec.json.encode(label))
            self._write(self._path(sha256), data)
        except OSError as error:
            raise RefusedError(f"cannot store the model: {error.strerror}") from None

    def activate(self, sha256: str) -> None:
        """Make a stored model the active one; what was active becomes the previous one.

        Raises:
            RefusedError: it is not stored, or the disk refuses; the old one stays active.

        """
        old = self.pointer
        if old.active == sha256:
            return
        if not self._path(sha256).is_file():
            raise RefusedError(f"there is no stored model {sha256[:12]}: push it again")
        try:
            self._write(
                self._directory / "active.json", msgspec.json.encode(Pointer(sha256, old.active))
            )
        except OSError as error:
            raise RefusedError(f"cannot activate the model: {error.strerror}") from None
        self._forget_oldest()

    def _forget_oldest(self) -> None:
        pointer = self.pointer
        spare = [m for m in self.models() if m.sha256 not in (pointer.active, pointer.previous)]
        for model in spare[max(0, self._keep - 2) :]:
            with contextlib.suppress(OSError):
                self._path(model.sha256).unlink()
                self._label_path(model.sha256).unlink(missing_ok=True)

    def _label(self, sha256: str) -> Label:
        try:
            return msgspec.json.decode(self._label_path(sha256).read_bytes(), type=Label)
        except (OSError, msgspec.DecodeError):
            return Label()

    def _label_path(self, sha256: str) -> Path:
        return self._directory / f"{sha256}.json"

    def _path(self, sha256: str) -> Path:
        return self._directory / f"{sha256}.onnx"

    def _write(self, path: Path, data: bytes) -> None:
        temporary = path.with_suffix(f".{os.getpid()}.{time.monotonic_ns()}.tmp")
        try:
            with temporary.open("wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            temporary.rename(path)
        except OSError:
            with contextlib.suppress(OSError):
                temporary.unlink()
            raise
        directory = os.open(self._directory, os.O_RDONLY)
        try:
            os.fsync(directory)
        finally:
            os.close(directory)
