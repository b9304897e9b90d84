"""The robot's TLS files, looked at before Zenoh gets them: it names no cause for refusing.

They are tried out in a handshake of the robot with itself, in memory. That takes nothing but the
standard library, and finds whatever a workstation would find.
"""

import ssl
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from mbot_agent.configuration import Tls
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.wire.access_rules import Kind, split_common_name

RENEW_BEFORE = timedelta(days=30)

RENEW_ADVICE = "renew it by `workstation enroll --renew` where it was made"

# OpenSSL's codes for a certificate out of its time (X509_V_ERR_...).
_NOT_YET_VALID = 9
_EXPIRED = 10


@dataclass(frozen=True, slots=True)
class Validity:
    """How long the robot's certificate will do.

    Attributes:
        usable: false if no workstation will accept it now.
        advice: what to do about it; empty if there is time.
        until: in words for people: "2027-11-21".

    """

    usable: bool
    advice: str
    until: str


def check_certificates(tls: Tls, robot_id: str) -> Validity:
    """Whether the three files belong together and to this robot, and for how long.

    A certificate out of its time is not an error: this computer's clock may be wrong as well,
    until it has found the time on the network.

    Raises:
        ConfigurationError: a file is missing, unreadable or not what it should be.

    """
    for setting, path in (("ca", tls.ca), ("certificate", tls.certificate), ("key", tls.key)):
        _check_readable(setting, path)
    try:
        certificate = _shown_to_a_workstation(_server(tls), _client(tls))
    except ssl.SSLCertVerificationError as error:
        if error.verify_code == _EXPIRED:
            return Validity(False, f"the robot's certificate has expired: {RENEW_ADVICE}", "now")
        if error.verify_code == _NOT_YET_VALID:
            advice = "the robot's certificate is not valid yet: is the clock right? (timedatectl)"
            return Validity(False, advice, "later")
        raise ConfigurationError(
            f"network.tls.certificate: {tls.certificate} is not accepted by {tls.ca} "
            f"({error.verify_message.rstrip('.')}): copy both again"
        ) from None
    except ssl.SSLError as error:
        raise ConfigurationError(f"network.tls: cannot be used: {error.reason}") from None
    _check_owner(certificate, tls.certificate, robot_id)
    expires = datetime.fromtimestamp(ssl.cert_time_to_seconds(certificate["notAfter"]), UTC)
    soon = expires - datetime.now(UTC) < RENEW_BEFORE
    advice = f"the robot's certificate expires on {expires:%Y-%m-%d}: {RENEW_ADVICE}"
    return Validity(True, advice if soon else "", f"{expires:%Y-%m-%d}")


def _server(tls: Tls) -> ssl.SSLContext:
    server = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    try:
        server.load_cert_chain(tls.certificate, tls.key, password="")
    except ssl.SSLError:
        raise ConfigurationError(
            f"network.tls.key: {tls.certificate} and {tls.key} are not a certificate with its key "
            "in PEM form, without a password: copy both again"
        ) from None
    return server


def _client(tls: Tls) -> ssl.SSLContext:
    client = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    client.check_hostname = False
    try:
        client.load_verify_locations(tls.ca)
    except ssl.SSLError:
        raise ConfigurationError(
            f"network.tls.ca: {tls.ca} holds no certificate in PEM form"
        ) from None
    return client


def _shown_to_a_workstation(server: ssl.SSLContext, client: ssl.SSLContext) -> dict[str, Any]:
    """The server's certificate, as the client has verified it."""
    to_server, to_client = ssl.MemoryBIO(), ssl.MemoryBIO()
    here = server.wrap_bio(to_server, to_client, server_side=True)
    there = client.wrap_bio(to_client, to_server)
    waiting = [there, here]
    while waiting:
        for side in list(waiting):
            try:
                side.do_handshake()
                waiting.remove(side)
            except ssl.SSLWantReadError:
                continue  # the other side speaks next
    return there.getpeercert() or {}


def _check_owner(certificate: dict[str, Any], path: str, robot_id: str) -> None:
    """A certificate of another origin may be named as it likes."""
    names = {name: value for entry in certificate["subject"] for name, value in entry}
    owner = split_common_name(names.get("commonName", ""))
    if owner is not None and owner != (Kind.ROBOT, robot_id):
        raise ConfigurationError(
            f"network.tls.certificate: {path} is that of {owner[0].value} {owner[1]}, this is "
            f"robot {robot_id}: copy this robot's"
        )


def _check_readable(setting: str, path: str) -> None:
    try:
        with Path(path).open("rb"):
            return
    except PermissionError:
        raise ConfigurationError(
            f"network.tls.{setting}: may not read {path}: `sudo chgrp mbot-agent {path}` and `sudo "
            f"chmod 0640 {path}`"
        ) from None
    except OSError as error:
        raise ConfigurationError(
            f"network.tls.{setting}: cannot read {path}: {error.strerror}"
        ) from None
