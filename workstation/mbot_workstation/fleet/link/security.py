"""The certificates with which a workstation and a robot know each other (mutual TLS)."""

from dataclasses import dataclass
from pathlib import Path

from mbot_protocol.errors import ConfigurationError


@dataclass(frozen=True, slots=True)
class LinkSecurity:
    """Files in PEM form for a `tls/` address.

    Attributes:
        ca: the authority that signed the robot's certificate.
        certificate: this workstation's own, where the robot asks for one.
        key: the private key of `certificate`; P-256 in PKCS#8 form is known to work.

    Raises:
        ConfigurationError: a file is missing, or a certificate comes without its key.

    """

    ca: Path
    certificate: Path | None = None
    key: Path | None = None

    def __post_init__(self) -> None:
        if (self.certificate is None) != (self.key is None):
            raise ConfigurationError("--certificate and --key belong together: give both or none")
        for path in (self.ca, self.certificate, self.key):
            if path is not None and not path.is_file():
                raise ConfigurationError(f"no such file: {path}; it should hold a certificate")


def link_security(
    ca: Path | None, certificate: Path | None, key: Path | None
) -> LinkSecurity | None:
    """The security that three optional options ask for; None without any of them.

    Raises:
        ConfigurationError: as `LinkSecurity`, or the authority is missing.

    """
    if ca is None:
        if certificate is not None or key is not None:
            raise ConfigurationError("--certificate and --key need --ca, the robot's authority")
        return None
    return LinkSecurity(ca, certificate, key)


def owner_name(certificate_pem: bytes) -> str:
    """The common name in a certificate; empty if it has none or is not a certificate."""
    from cryptography import x509  # 30 ms, and only those who show a certificate need it

    try:
        certificate = x509.load_pem_x509_certificate(certificate_pem)
    except ValueError:
        return ""
    names = certificate.subject.get_attributes_for_oid(x509.NameOID.COMMON_NAME)
    return str(names[0].value) if names else ""
