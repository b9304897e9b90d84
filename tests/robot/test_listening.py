"""Why an address cannot be listened at, found out by trying."""

import socket
import subprocess
import sys
from pathlib import Path

import pytest

from mbot_agent.network.listening import obstacle

SERVER = """
import socket, sys
with socket.create_server(("127.0.0.1", 0)) as server:
    print(server.getsockname()[1], flush=True)
    sys.stdin.read()
"""


def test_a_free_address_is_free_and_stays_so() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    for _ in range(2):
        assert obstacle(f"tcp/127.0.0.1:{port}") is None
        assert obstacle(f"tls/[::1]:{port}#tls_handshake_timeout_ms=2000") is None


@pytest.mark.parametrize("name", ["mbot-agent", "webcam.py"])
def test_who_has_the_port_is_named(name: str, tmp_path: Path) -> None:
    script = tmp_path / name
    script.write_text(SERVER)
    with subprocess.Popen(
        [sys.executable, str(script)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as program:
        assert program.stdin is not None
        assert program.stdout is not None
        port = int(program.stdout.readline())
        found = [obstacle(f"tcp/{host}:{port}") for host in ("127.0.0.1", "0.0.0.0", "localhost")]
        program.stdin.close()
    for each in found:
        assert each is not None
        assert each.is_agent is (name == "mbot-agent")
        assert f"(process {program.pid})" in each.reason
        assert (name if each.is_agent else Path(sys.executable).name) in each.reason


@pytest.mark.parametrize(
    ("endpoint", "reason"),
    [
        ("tcp/192.0.2.1:7447", "has no address 192.0.2.1"),
        ("tcp/no.such.name.invalid:7447", "does not know the name"),
        ("tcp/127.0.0.1:99999", "is no port"),
        ("tcp/127.0.0.1:seven", "is no port"),
    ],
)
def test_an_address_of_nobody_here_is_called_so(endpoint: str, reason: str) -> None:
    found = obstacle(endpoint)
    assert found is not None
    assert reason in found.reason
    assert not found.is_agent
