"""Ed25519 signatures (RFC 8032) checked by the OpenSSL that Python itself has loaded for hashlib.

The package `cryptography` has the same OpenSSL inside a second time, which is 8 MB of a daemon's
memory. It is asked only where Python was built without a shared OpenSSL, and it makes signatures.
"""

import ctypes
import functools
from collections.abc import Callable

PUBLIC_KEY_BYTES = 32
SIGNATURE_BYTES = 64

IsGenuine = Callable[[bytes, bytes, bytes], bool]
"""As `is_genuine`."""

_NID_ED25519 = 1087
"""OpenSSL's number for this kind of key (obj_mac.h)."""

_POINTER, _BYTES, _SIZE, _INT = ctypes.c_void_p, ctypes.c_char_p, ctypes.c_size_t, ctypes.c_int

_PROTOTYPES = {
    "EVP_PKEY_new_raw_public_key": (_POINTER, (_INT, _POINTER, _BYTES, _SIZE)),
    "EVP_PKEY_free": (None, (_POINTER,)),
    "EVP_MD_CTX_new": (_POINTER, ()),
    "EVP_MD_CTX_free": (None, (_POINTER,)),
    "EVP_DigestVerifyInit": (_INT, (_POINTER, _POINTER, _POINTER, _POINTER, _POINTER)),
    "EVP_DigestVerify": (_INT, (_POINTER, _BYTES, _SIZE, _BYTES, _SIZE)),
    "ERR_clear_error": (None, ()),
}
"""Result and arguments, the same since OpenSSL 1.1.1."""


def is_genuine(public_key: bytes, signature: bytes, message: bytes) -> bool:
    """Whether the key's owner has signed the message. Whatever is wrong, the answer is no."""
    if len(public_key) != PUBLIC_KEY_BYTES or len(signature) != SIGNATURE_BYTES:
        return False
    return _checker()(public_key, signature, message)


@functools.cache
def _checker() -> IsGenuine:
    return by_openssl() or by_cryptography


def by_openssl() -> IsGenuine | None:
    """A checker by Python's own OpenSSL; None where there is none to be called."""
    try:
        import _hashlib

        # Looking a name up in the module finds it in the libcrypto it was linked with.
        library = ctypes.CDLL(_hashlib.__file__)
        functions = {name: getattr(library, name) for name in _PROTOTYPES}
    except (ImportError, AttributeError, OSError):
        return None
    for name, (result, arguments) in _PROTOTYPES.items():
        functions[name].restype, functions[name].argtypes = result, arguments
    return functools.partial(_check, functions)


def _check(
    openssl: dict[str, Callable[..., int]], public_key: bytes, signature: bytes, message: bytes
) -> bool:
    key = openssl["EVP_PKEY_new_raw_public_key"](_NID_ED25519, None, public_key, len(public_key))
    context = openssl["EVP_MD_CTX_new"]()
    try:
        # 1 is yes; 0 and everything below is no.
        return (
            bool(key and context)
            and openssl["EVP_DigestVerifyInit"](context, None, None, None, key) == 1
            and openssl["EVP_DigestVerify"](
                context, signature, len(signature), message, len(message)
            )
            == 1
        )
    finally:
        openssl["EVP_MD_CTX_free"](context)
        openssl["EVP_PKEY_free"](key)
        # What it complained of waits in this thread; ssl would take it for an error of its own.
        openssl["ERR_clear_error"]()


def by_cryptography(public_key: bytes, signature: bytes, message: bytes) -> bool:
    """The same by the package `cryptography`."""
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

    try:
        Ed25519PublicKey.from_public_bytes(public_key).verify(signature, message)
    except (InvalidSignature, ValueError):
        return False
    return True
