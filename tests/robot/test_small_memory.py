"""In processes of their own: what a module has loaded stays loaded."""

import hashlib
import hmac
import subprocess
import sys
from pathlib import Path

from mbot_agent.process.small_memory import OPENSSL, without_openssl


def run(script: str) -> str:
    return subprocess.run(
        [sys.executable, "-c", f"import sys\n{script}"], capture_output=True, text=True, check=True
    ).stdout.strip()


def test_hashes_and_http_do_without_openssl_and_ssl_is_there_later() -> None:
    told = run(
        "from mbot_agent.process.small_memory import without_openssl\n"
        "with without_openssl():\n"
        "    import hashlib, hmac, http.client, secrets\n"
        "loaded = [name for name in ('_hashlib', '_ssl') if name in sys.modules]\n"
        "assert not any('libcrypto' in line for line in open('/proc/self/maps'))\n"
        "import ssl\n"
        "print(loaded, hashlib.sha256(b'a').hexdigest(), hashlib.sha512(b'a').hexdigest(),\n"
        "      hmac.new(b'k', b'm', 'sha256').hexdigest(), len(secrets.token_hex(4)),\n"
        "      ssl.SSLContext.__name__)"
    )
    by_openssl = hashlib.sha256(b"a"), hashlib.sha512(b"a"), hmac.new(b"k", b"m", "sha256")
    hashes = " ".join(one.hexdigest() for one in by_openssl)
    assert told == f"[] {hashes} 8 SSLContext"


def test_nothing_is_left_behind() -> None:
    before = {name: sys.modules.get(name) for name in OPENSSL}
    with without_openssl():
        pass
    assert {name: sys.modules.get(name) for name in OPENSSL} == before


def test_what_is_loaded_already_is_left_alone() -> None:
    told = run(
        "import ssl\n"
        "from mbot_agent.process.small_memory import without_openssl\n"
        "with without_openssl():\n"
        "    print(sys.modules['ssl'] is ssl, sys.modules['_hashlib'])\n"
        "print('_hashlib' in sys.modules)"
    )
    assert told.splitlines() == ["True None", "False"]


def test_numpys_unused_parts_are_loaded_by_who_uses_them(tmp_path: Path) -> None:
    """A stand-in for numpy 1, which imports them with itself."""
    numpy = tmp_path / "numpy"
    numpy.mkdir()
    (numpy / "__init__.py").write_text("from . import linalg, random\nprint('numpy')\n")
    for name in ("linalg", "random"):
        (numpy / f"{name}.py").write_text(f"print({name!r})\nnumber = 4\n")
    uses = f"sys.path.insert(0, {str(tmp_path)!r})\nimport numpy\nprint(numpy.random.number)"
    waits = "from mbot_agent.process.small_memory import let_unused_numpy_wait as wait\nwait()\n"
    assert run(uses).split() == ["linalg", "random", "numpy", "4"]
    assert run(waits + uses).split() == ["linalg", "numpy", "random", "4"]


POOLS = """
import ctypes, re, tempfile, threading
libc = ctypes.CDLL(None)
libc.fopen.restype, libc.malloc.restype = ctypes.c_void_p, ctypes.c_void_p
ready, over = threading.Barrier(5), threading.Event()

def work():
    libc.malloc(100)
    ready.wait()
    over.wait()

for _ in range(4):
    threading.Thread(target=work).start()
ready.wait()
with tempfile.NamedTemporaryFile() as file:
    stream = ctypes.c_void_p(libc.fopen(file.name.encode(), b"w"))
    libc.malloc_info(0, stream)
    libc.fclose(stream)
    print(len(re.findall(rb"<heap nr", file.read())))
over.set()
"""


def test_threads_share_one_pool() -> None:
    """malloc_info(3) counts them."""
    assert int(run(POOLS)) > 1
    shared = "from mbot_agent.process.small_memory import share_one_pool\nshare_one_pool()"
    assert run(shared + POOLS) == "1"
