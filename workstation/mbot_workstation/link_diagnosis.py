"""Why a connection did not come about: Zenoh only says 'Timeout', so knock once more and look.

Sockets and TLS of the standard library tell apart what Zenoh does not: a name that does not
resolve, a refused connection, the wrong authority, a missing certificate, plain TCP against TLS.
"""

import socket
import ssl

from mbot_workstation.address import Endpoint
from mbot_workstation.link_security import LinkSecurity

TUNNEL_ADVICE = (
    "mbot-agent listens on the robot's loopback unless configured otherwise: "
    "tunnel with `ssh -L 7447:127.0.0.1:7447 ROBOT` and use 127.0.0.1"
)

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
        advice = (
            "is mbot-agent running there, and the SSH tunnel up?"
            if endpoint.is_loopback
            else f"is mbot-agent running? {TUNNEL_ADVICE}"
        )
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
        return f"it speaks TLS: use {secure} with --ca, --certificate and --key"
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
            return f"{security.certificate} and {security.key} are no certificate with its key"
    error = _handshake_error(endpoint, ours, timeout_s)
    if isinstance(error, ssl.SSLCertVerificationError):
        return (
            f"the robot's certificate is not accepted ({error.verify_message.rstrip('.')}); is "
            f"{security.ca} its authority, and {endpoint.host} a name in the certificate?"
        )
    if _is_alert(error):
        if security.certificate is None:
            return "the robot asks for a certificate: give --certificate and --key"
        return f"the robot does not accept {security.certificate}; is it of the robot's authority?"
    if error is not None:
        return "no TLS is spoken there; is the robot set up for tls/, or is it tcp/?"
    return (
        "TLS works but no Zenoh session opens; is it an mbot-agent, and does it perhaps serve as "
        "many workstations as it may?"
    )


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
