"""X.509 certificates: the fleet's authority, and those it signs. No files here."""

import ipaddress
import secrets
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.wire.access_rules import Kind, common_name

AUTHORITY_DAYS = 20 * 365
"""Longer than a robot lives: a new authority means enrolling everybody again."""

CERTIFICATE_DAYS = 365

BACKDATED = timedelta(days=30)
"""A Raspberry Pi has no battery for its clock: until it has found the time it may be late."""

_USES = {
    # A robot serves workstations and calls routers; a person only ever calls.
    Kind.ROBOT: (ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH),
    Kind.ROUTER: (ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH),
    Kind.PERSON: (ExtendedKeyUsageOID.CLIENT_AUTH,),
}


@dataclass(frozen=True, slots=True)
class Identity:
    """A certificate with its private key (P-256, PKCS#8 without password), both in PEM form."""

    certificate_pem: bytes
    key_pem: bytes

    @property
    def certificate(self) -> x509.Certificate:
        """The certificate, parsed."""
        return x509.load_pem_x509_certificate(self.certificate_pem)

    @property
    def expires(self) -> datetime:
        """When it ends to be valid, in UTC."""
        return self.certificate.not_valid_after_utc


def make_authority(now: datetime | None = None) -> Identity:
    """A new authority, able to sign certificates but no further authorities."""
    key = ec.generate_private_key(ec.SECP256R1())
    subject = _subject(f"mbot-agent fleet {secrets.token_hex(4)}")
    usage = _key_usage(signs_certificates=True)
    builder = (
        _builder(subject, subject, key.public_key(), now or datetime.now(UTC), AUTHORITY_DAYS)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(usage, critical=True)
    )
    return _identity(builder.sign(key, hashes.SHA256()), key)


def issue(
    authority: Identity,
    kind: Kind,
    name: str,
    hosts: Iterable[str] = (),
    now: datetime | None = None,
    days: float = CERTIFICATE_DAYS,
) -> Identity:
    """A certificate signed by the authority.

    Args:
        authority: with its key.
        kind: what the certificate belongs to; stands in it, before the name.
        name: of the robot, person or router.
        hosts: names and addresses under which a robot or router is reached.
        now: the time of issue.
        days: how long it is valid.

    Raises:
        ConfigurationError: a host is no name and no address.

    """
    signer = serialization.load_pem_private_key(authority.key_pem, password=None)
    assert isinstance(signer, ec.EllipticCurvePrivateKey)  # we have made it
    issuer = authority.certificate
    key = ec.generate_private_key(ec.SECP256R1())
    subject = _subject(common_name(kind, name))
    builder = (
        _builder(subject, issuer.subject, key.public_key(), now or datetime.now(UTC), days)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_key_usage(signs_certificates=False), critical=True)
        .add_extension(x509.ExtendedKeyUsage(_USES[kind]), critical=False)
        .add_extension(
            x509.AuthorityKeyIdentifier.from_issuer_public_key(signer.public_key()), critical=False
        )
    )
    if names := [_general_name(host) for host in hosts]:
        builder = builder.add_extension(x509.SubjectAlternativeName(names), critical=False)
    return _identity(builder.sign(signer, hashes.SHA256()), key)


def check_issued(identity: Identity, authority_pem: bytes, origin: str) -> None:
    """Whether a certificate goes with its key and was signed by the authority.

    Raises:
        ConfigurationError: it was not; `origin` names it.

    """
    try:
        authority = x509.load_pem_x509_certificate(authority_pem)
        identity.certificate.verify_directly_issued_by(authority)
        key = serialization.load_pem_private_key(identity.key_pem, password=None)
    except (ValueError, TypeError, InvalidSignature):
        raise ConfigurationError(f"{origin}: certificate and authority do not fit") from None
    if key.public_key() != identity.certificate.public_key():
        raise ConfigurationError(f"{origin}: certificate and key do not fit")


def hosts_in(certificate: x509.Certificate) -> set[str]:
    """The names and addresses a certificate is for."""
    try:
        extension = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName)
    except x509.ExtensionNotFound:
        return set()
    return {str(name.value) for name in extension.value}


def _subject(name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])


def _builder(
    subject: x509.Name,
    issuer: x509.Name,
    key: ec.EllipticCurvePublicKey,
    now: datetime,
    days: float,
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - BACKDATED)
        .not_valid_after(now + timedelta(days=days))
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key), critical=False)
    )


def _key_usage(*, signs_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        encipher_only=False,
        decipher_only=False,
    )


def _general_name(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        pass
    try:
        return x509.DNSName(host)
    except ValueError:
        raise ConfigurationError(
            f"host {host!r} is no name and no address, expected such as mbot-1.local or 10.0.0.5"
        ) from None


def _identity(certificate: x509.Certificate, key: ec.EllipticCurvePrivateKey) -> Identity:
    return Identity(
        certificate.public_bytes(serialization.Encoding.PEM),
        key.private_bytes(
            serialization.Encoding.PEM,
            serialization.PrivateFormat.PKCS8,
            serialization.NoEncryption(),
        ),
    )
