"""Why a connection did not come about: Zenoh only says 'Timeout', so knock once more and look.

Sockets and TLS of the standard library tell apart what Zenoh does not: a name that does not
resolve, a refused connection, the wrong authority, a missing certificate, plain TCP against TLS.
"""

import socket
import ssl

from mbot_workstation.fleet.link.address import Endpoint
from mbot_workstation.fleet.link.security import LinkSecurity

TUNNEL_ADVICE = (
    "mbot-agent listens on the robot's loopback unless configured otherwise: "
    "tunnel with `ssh -L 7447:127.0.0.1:7447 ROBOT` and use 127.0.0.1"
)

RENEW_ADVICE = "`workstation enroll --renew` renews it"

# OpenSSL's codes for why a certificate is not accepted (X509_V_ERR_...).
_NOT_YET_VALID = 9
_EXPIRED = 10
_OTHER_HOST = 62
_OTHER_ADDRESS = 64

HANDSHAKE_TIMEOUT_S = 2.0
"""A person has waited for Zenoh already; a peer without TLS answers a handshake with nothing."""


def why_unreachable(endpoint: Endpoint, timeout_s: float) -> str | None:
    """What stops a plain TCP connection, and what to do; None if there is one to be had."""
    try:
        with socket.create_connection((endpoint.host, endpoint.port), timeout=timeout_s):
            return None
    except socket.gaierror:
        return f"the name {endpoint.host!r} is not known; try the robot's IP address"
    except ConnectionRefusedError:
        if endpoint.protocol == "tls":
            advice = "is mbot-agent running, and has its enrolment been copied to it?"
        elif endpoint.is_loopback:
            advice = "is mbot-agent running there, and the SSH tunnel up?"
        else:
            advice = f"is mbot-agent running? {TUNNEL_ADVICE}"
        return f"nothing listens there; {advice}"
    except TimeoutError:
        return "no answer; is the robot switched on and in this network, is a firewall between?"
    except OSError as error:
        return f"{error.strerror or error}; is the robot in this network?"


def why_no_session(endpoint: Endpoint, security: LinkSecurity | None, timeout_s: float) -> str:
    """What stops a session although something listens, as far as a TLS handshake tells."""
    timeout_s = min(timeout_s, HANDSHAKE_TIMEOUT_S)
    if endpoint.protocol == "tls" and security is not None:
        return _why_tls_fails(endpoint, security, timeout_s)
    anyone = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    anyone.check_hostname = False
    anyone.verify_mode = ssl.CERT_NONE
    error = _handshake_error(endpoint, anyone, timeout_s)
    if error is None or _is_alert(error):
        secure = Endpoint("tls", endpoint.host, endpoint.port)
        return (
            f"it speaks TLS: name an enrolled robot (`workstation enroll`), or use {secure} with "
            "--ca, --certificate and --key"
        )
    return (
        "something listens there but opens no Zenoh session; is it an mbot-agent, and does it "
        "perhaps serve as many workstations as it may?"
    )


def _why_tls_fails(endpoint: Endpoint, security: LinkSecurity, timeout_s: float) -> str:
    ours = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    try:
        ours.load_verify_locations(security.ca)
    except (ssl.SSLError, OSError):
        return f"{security.ca} holds no certificate authority in PEM form"
    if security.certificate is not None:
        try:
            ours.load_cert_chain(security.certificate, security.key)
        except (ssl.SSLError, OSError):
            return f"{security.certificate} and {security.key} are not a certificate with its key"
    error = _handshake_error(endpoint, ours, timeout_s)
    if isinstance(error, ssl.SSLCertVerificationError):
        return _why_not_accepted_here(endpoint, security, error)
    if isinstance(error, ssl.SSLError) and _is_alert(error):
        return _why_not_accepted_there(security, error)
    if error is not None:
        return "no TLS is spoken there; is the robot set up for tls/, or is it tcp/?"
    return (
        "TLS works but no Zenoh session opens; is it an mbot-agent, and does it perhaps serve as "
        "many workstations as it may?"
    )


def _why_not_accepted_here(
    endpoint: Endpoint, security: LinkSecurity, error: ssl.SSLCertVerificationError
) -> str:
    """In words, why this side does not take the robot's certificate."""
    cause = {
        _EXPIRED: f"it has expired; {RENEW_ADVICE}, and is the clock right here?",
        _NOT_YET_VALID: "it is not valid yet; is the clock right here?",
        _OTHER_HOST: f"it is not for {endpoint.host}; use another of the robot's names, or "
        f"enrol it with --host {endpoint.host}",
    }
    cause[_OTHER_ADDRESS] = cause[_OTHER_HOST]
    why = cause.get(
        error.verify_code,
        f"{error.verify_message.rstrip('.')}; is {security.ca} its authority, and is it a robot's?",
    )
    return f"the robot's certificate is not accepted: {why}"


def _why_not_accepted_there(security: LinkSecurity, error: ssl.SSLError) -> str:
    """In words, why the robot does not take this side's certificate."""
    if security.certificate is None:
        return "the robot asks for a certificate: give --certificate and --key"
    refused = f"the robot does not accept {security.certificate}"
    if "EXPIRED" in (error.reason or ""):
        return f"{refused}: it has expired, or the robot's clock is wrong; {RENEW_ADVICE}"
    return f"{refused}; is it of the robot's authority?"


def _is_alert(error: Exception | None) -> bool:
    """Whether the other side speaks TLS and refuses us."""
    return isinstance(error, ssl.SSLError) and "alert" in str(error).lower()


def _handshake_error(
    endpoint: Endpoint, context: ssl.SSLContext, timeout_s: float
) -> Exception | None:
    try:
        with (
            socket.create_connection((endpoint.host, endpoint.port), timeout=timeout_s) as plain,
            context.wrap_socket(plain, server_hostname=endpoint.host) as secure,
        ):
            # With TLS 1.3 the client is done before the server has judged the client's
            # certificate: its refusal arrives only with the first read.
            secure.settimeout(min(0.5, timeout_s))
            secure.recv(1)
    except TimeoutError as error:
        return None if "read" in str(error) else error
    except OSError as error:  # ssl.SSLError is one
        return error
    return None
