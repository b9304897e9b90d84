"""The Rerun viewer's side: without Rerun one line, with it a file that holds the drive."""

import json
import shutil
import signal
import socket
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from typer.testing import CliRunner

from mbot_protocol.errors import ConfigurationError, UnreachableError
from mbot_protocol.v1.messages_pb2 import Decision, Fault, State
from mbot_workstation.cli.drives import ViewOptions
from mbot_workstation.cli.subcommands import app
from mbot_workstation.look.drives.rerun_view import RerunView, changes

from ..free_port import free_port
from ..ran import WORKSTATION, ran
from ..until import until
from .fake_robot import FakeRobot
from .samples import decision, picture

RECORDED = Path(__file__).parents[1] / "data" / "recorded-drive"


def test_without_rerun_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(ConfigurationError, match=r"view needs rerun.*\[view\]"):
        RerunView(["mbot-1"])
    assert not ViewOptions().web


def test_what_changed_is_told_once() -> None:
    first = Decision(model_sha256="ab" * 32, state=State.STATE_RUNNING, stop_count=1)
    assert changes(None, first) == [("INFO", "model abababababab"), ("INFO", "now running")]
    assert changes(first, first) == []
    fault = Fault(kind="stuck", detail="the picture stands still")
    then = Decision(model_sha256="ab" * 32, state=State.STATE_STOPPED, stop_count=2, faults=[fault])
    assert changes(first, then) == [
        ("INFO", "now stopped"),
        ("ERROR", "stuck: the picture stands still"),
        ("WARN", "stopped"),
    ]


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("setpriv") is None, reason="not Linux")
def test_a_page_ends_with_its_command_even_where_that_is_killed(tmp_path: Path) -> None:
    ports = free_port(), free_port()
    command = [*WORKSTATION, "view", str(RECORDED), "--web"]
    command += ["--no-browser", "--grpc-port", str(ports[0]), "--web-port", str(ports[1])]
    with (tmp_path / "said").open("w") as said, subprocess.Popen(command, stdout=said) as viewing:
        assert until(lambda: "look at" in (tmp_path / "said").read_text(), 60)
        assert listens(ports[0])
        viewing.kill()
    assert until(lambda: not any(listens(port) for port in ports), 10)


@pytest.mark.slow
def test_a_page_ends_with_its_command_and_takes_no_others_ports(tmp_path: Path) -> None:
    ports = free_port(), free_port()
    command = [*WORKSTATION, "view", str(RECORDED), "--web"]
    command += ["--no-browser", "--grpc-port", str(ports[0]), "--web-port", str(ports[1])]
    with (tmp_path / "said").open("w") as said, subprocess.Popen(command, stdout=said) as first:
        assert until(lambda: "look at" in (tmp_path / "said").read_text(), 60)
        second = ran(*command)
        assert second.returncode == 2
        assert f"port {ports[0]} is taken" in second.stderr
        assert len(second.stderr.splitlines()) == 1
        assert first.poll() is None
        first.send_signal(signal.SIGTERM)
        assert first.wait(20) == 130
    assert until(lambda: not any(listens(port) for port in ports), 10)


def listens(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


@pytest.mark.slow
def test_several_live_robots_and_a_map_are_in_one_view(robot: FakeRobot, tmp_path: Path) -> None:
    map_file, path = tmp_path / "path.jsonl", tmp_path / "live.rrd"
    place = {"unix_s": 1.0, "x": 0.25, "y": 0.5, "yaw": 0.0, "object": [1.0, 1.0, 0.0]}
    map_file.write_text(json.dumps(place) + "\n")
    stop = threading.Event()

    def publish(to: FakeRobot) -> None:
        sequence = 0
        while not stop.wait(0.02):
            sequence += 1
            message = decision(sequence)
            message.robot_id = to.robot_id
            to.publish(message)
            to.publish(picture(message.unix_time_ns))

    with FakeRobot("mbot-2") as other, ThreadPoolExecutor(2) as pool:
        pool.submit(publish, robot)
        pool.submit(publish, other)
        try:
            addresses = ["--robot", robot.address, "--robot", other.address, "--seconds", "1.5"]
            maps = ["--map", f"mbot-2={map_file}"]
            result = CliRunner().invoke(app, ["view", *addresses, *maps, "--save", str(path)])
        finally:
            stop.set()
    assert result.exit_code == 0, result.output
    data = path.read_bytes()
    for name in (
        b"mbot-1/observation",
        b"mbot-2/observation",
        b"mbot-2/map/path",
        b"mbot-2/wheels",
    ):
        assert name in data
    assert b"mbot-1/map" not in data


def test_what_mattered_to_the_policy_is_shown_when_asked_for(tmp_path: Path) -> None:
    path, model = tmp_path / "drive.rrd", str(RECORDED / "seeing.onnx")
    command = ["view", str(RECORDED)]
    saving = [*command, "--save", str(path)]
    result = CliRunner().invoke(app, [*saving, "--attention", "--model", model])
    assert result.exit_code == 0, result.output
    data = path.read_bytes()
    assert b"virtual/attention" in data
    assert b"virtual/action/left_without_memory" in data
    for told, words in (
        (["view", "--attention"], "--attention is for recordings"),
        (["view", "--model", model], "--attention is for recordings"),
        (["view", "--foxglove", "--attention"], "--attention is for recordings"),
        ([*command, "--model", model], "--model does nothing without --attention"),
    ):
        result = CliRunner().invoke(app, told)
        assert isinstance(result.exception, ConfigurationError)
        assert words in str(result.exception)
    path.unlink()
    result = CliRunner().invoke(app, [*saving, "--attention", "--model", __file__])
    assert "where it looked is not shown: model 93277d5c321b" in result.stderr
    assert b"without_memory" not in path.read_bytes()
    path.unlink()
    CliRunner().invoke(app, saving)
    assert b"virtual/attention" not in path.read_bytes()


def test_a_robot_that_is_off_is_left_out_of_several(robot: FakeRobot, tmp_path: Path) -> None:
    off = f"127.0.0.1:{free_port()}"
    path = tmp_path / "live.rrd"
    for addresses in ([off, robot.address], [robot.address, off]):
        path.unlink(missing_ok=True)
        command = ["view", "--seconds", "0.2", "--save", str(path)]
        for address in addresses:
            command += ["--robot", address]
        result = CliRunner().invoke(app, command)
        assert result.exit_code == 0, result.output
        assert "nothing listens there" in result.output
    path.unlink()
    result = CliRunner().invoke(app, ["view", "--robot", off, "--save", str(path)])
    assert isinstance(result.exception, UnreachableError)
    wrong = ["--robot", robot.address, "--map", "mbot-9=a.jsonl"]
    result = CliRunner().invoke(app, ["view", *wrong, "--save", str(path)])
    assert "expected ROBOT=FILE with one of mbot-1" in str(result.exception)


def test_a_recording_becomes_a_file_for_the_viewer(tmp_path: Path) -> None:
    path = tmp_path / "drive.rrd"
    result = CliRunner().invoke(app, ["view", str(RECORDED), "--save", str(path)])
    assert result.exit_code == 0, result.output
    data = path.read_bytes()
    assert len(data) > 50_000
    for name in (b"virtual/observation", b"virtual/wheels/left", b"virtual/log", b"robot_time"):
        assert name in data
    result = CliRunner().invoke(app, ["view", str(RECORDED), "--save", str(path)])
    assert isinstance(result.exception, ConfigurationError)
    assert "exists already" in str(result.exception)
    assert path.read_bytes() == data
