"""The fleet's folder on this workstation: keys, certificates, roll; for its owner's eyes only."""

import os
from pathlib import Path

from mbot_protocol.errors import ConfigurationError, RefusedError
from mbot_protocol.files import atomic_file
from mbot_protocol.wire.access_rules import Kind
from mbot_workstation.fleet.enrolment.certificates import Identity
from mbot_workstation.fleet.enrolment.roll import ROLL_FILE, Roll, encode_roll, read_roll
from mbot_workstation.fleet.link.security import LinkSecurity
from mbot_workstation.fleet.models.key_folder import KeyFolder

AUTHORITY = "authority"


def fleet_directory() -> Path:
    """`mbot-agent/fleet` in the user's configuration."""
    base = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    return Path(base) / "mbot-agent" / "fleet"


class FleetFolder:
    """Reads and writes the folder; every file whole or not at all, with mode 0600."""

    def __init__(self, path: Path | None = None) -> None:
        self.path = path or fleet_directory()

    def roll(self) -> Roll:
        """The roll.

        Raises:
            ConfigurationError: there is none yet, or it can't be read.

        """
        roll = read_roll(self.path)
        if roll is None:
            raise ConfigurationError(
                f"no fleet in {self.path}: `workstation enroll ROBOT` begins one, `workstation "
                "enroll --join FILE` joins somebody else's"
            )
        return roll

    def save_roll(self, roll: Roll) -> None:
        """Write the roll."""
        self.write(ROLL_FILE, encode_roll(roll))

    @property
    def has_authority(self) -> bool:
        """Whether certificates can be signed here; not where somebody has only joined."""
        return (self.path / f"{AUTHORITY}.key").exists()

    @property
    def authority(self) -> Identity:
        """The fleet's authority.

        Raises:
            RefusedError: it is on another workstation.
            ConfigurationError: its certificate or key can't be read.

        """
        if not self.has_authority:
            raise RefusedError(
                "this workstation has joined a fleet and cannot enrol anybody: ask the one who "
                "gave you the file"
            )
        return self._identity(AUTHORITY)

    @property
    def authority_pem(self) -> bytes:
        """The authority's certificate alone."""
        return (self.path / f"{AUTHORITY}.pem").read_bytes()

    def identity(self, kind: Kind, name: str) -> Identity:
        """The certificate and key of one of the fleet.

        Raises:
            ConfigurationError: one of them is missing, or can't be read.

        """
        return self._identity(f"{kind.value}s/{name}")

    def has_identity(self, kind: Kind, name: str) -> bool:
        """Whether there is a certificate of that name."""
        return (self.path / f"{kind.value}s" / f"{name}.pem").exists()

    def save_identity(self, kind: Kind, name: str, identity: Identity) -> None:
        """Keep a certificate and its key."""
        self._save_identity(f"{kind.value}s/{name}", identity)

    def save_authority(self, authority: Identity) -> None:
        """Keep the authority."""
        self._save_identity(AUTHORITY, authority)

    @property
    def signing_keys(self) -> KeyFolder:
        """The keys made for people to sign their models with."""
        return KeyFolder(self.path / "signing")

    def bundle_path(self, kind: Kind, name: str) -> Path:
        """The file to hand to a robot, person or router."""
        return self.path / f"{kind.value}s" / f"{name}.tar"

    def save_bundle(self, kind: Kind, name: str, data: bytes) -> bool:
        """Keep such a file; whether it is another one than before."""
        path = self.bundle_path(kind, name)
        if path.exists() and path.read_bytes() == data:
            return False
        self.write(f"{kind.value}s/{name}.tar", data)
        return True

    def delete(self, kind: Kind, name: str) -> None:
        """Remove everything of a name."""
        for ending in ("pem", "key", "tar"):
            (self.path / f"{kind.value}s" / f"{name}.{ending}").unlink(missing_ok=True)
        for ending in ("pem", "pub") if kind is Kind.PERSON else ():
            (self.signing_keys.path / f"{name}.{ending}").unlink(missing_ok=True)

    def security(self, me: str) -> LinkSecurity:
        """What this workstation shows to robots.

        Raises:
            ConfigurationError: a file is missing.

        """
        stem = self.path / f"{Kind.PERSON.value}s" / me
        certificate, key = stem.with_suffix(".pem"), stem.with_suffix(".key")
        return LinkSecurity(self.path / f"{AUTHORITY}.pem", certificate, key)

    def write(self, name: str, data: bytes) -> None:
        """Write one file below the folder.

        Raises:
            ConfigurationError: it can't be written.

        """
        path = self.path / name
        try:
            path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            self.path.chmod(0o700)
            atomic_file.replace(path, data, mode=0o600)
        except OSError as error:
            raise ConfigurationError(f"cannot write {path}: {error.strerror}") from None

    def _identity(self, stem: str) -> Identity:
        try:
            return Identity(
                (self.path / f"{stem}.pem").read_bytes(), (self.path / f"{stem}.key").read_bytes()
            )
        except OSError as error:
            raise ConfigurationError(
                f"cannot read {self.path / stem}.pem and .key: {error.strerror}"
            ) from None

    def _save_identity(self, stem: str, identity: Identity) -> None:
        self.write(f"{stem}.key", identity.key_pem)
        self.write(f"{stem}.pem", identity.certificate_pem)
