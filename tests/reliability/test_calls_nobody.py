"""The daemon calls nobody but its camera: each of its system calls for the network is looked at."""

import re
import signal
import sys

from ..end_to_end.processes import PROGRAMS, Daemon, Process, beats_on
from ..robot.fake_board import FakeBoard
from ..robot.tiny_models import constant_model
from .motion import driving

CALLED = re.compile(
    r"(?:connect|sendto|sendmsg|sendmmsg)\(.*?"
    r'(?:sin6?_port=htons\((\d+)\).*?inet_(?:addr|pton)\([^"]*"([^"]+)"|sun_path="([^"]+)")'
)


def watched(daemon: Daemon) -> Process:
    """strace steps aside: -D."""
    trace = str(daemon.directory / "trace")
    command = ["strace", "-D", "-f", "-qq", "--seccomp-bpf", "-e", "trace=network", "-o", trace]
    program = [sys.executable, PROGRAMS.format("mbot-agent"), "run", "--config", str(daemon.config)]
    return Process(*command, *program, log=daemon.log)


def test_from_its_start_to_its_end_it_calls_its_camera_and_nobody_else(
    daemon: Daemon, board: FakeBoard
) -> None:
    with daemon.camera(), driving(daemon, board, watched(daemon)) as process:
        daemon.push(constant_model(0.2, 0.2, name="second"))  # its trial is watched, too
        assert beats_on(daemon.status, 10)
        process.signal(signal.SIGTERM)
        process.wait()
    trace = (daemon.directory / "trace").read_text()
    called = set[str]()
    for line in trace.splitlines():
        if found := CALLED.search(line):
            port, host, path = found.groups()
            called.add(path or f"{host}:{port}")
    assert called == {f"127.0.0.1:{daemon.camera_port}"}
    listening = {
        f"{host}:{port}"
        for port, host in re.findall(r'bind\(.*?htons\((\d+)\).*?inet_addr\("([^"]+)"', trace)
    }
    assert listening == {daemon.address}
