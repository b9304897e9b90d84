"""What the updater asks of the system, in the system's words."""

import subprocess
from pathlib import Path

import pytest

from mbot_protocol.errors import RefusedError
from mbot_update import health_gate, system
from mbot_update.release_folders import ReleaseFolders

from .release_bench import HEALTHY, KEY, Robot

SHOWN = """ActiveState=active
MainPID=77
StatusText=fault; camera-lost board-lost
Result=success
ExecMainStatus=0
"""


def test_the_service_is_read_from_systemctl(monkeypatch: pytest.MonkeyPatch) -> None:
    done = subprocess.CompletedProcess([], 0, SHOWN, "")
    monkeypatch.setattr(system, "_run", lambda *_: done)
    found = system.service()
    assert (found.state, found.pid, found.is_armed) == ("active", 77, True)
    assert found.faults == {"camera-lost", "board-lost"}
    monkeypatch.setattr(system, "_run", lambda *_: subprocess.CompletedProcess([], 127, "", ""))
    assert system.service().state == ""


def test_a_program_that_hangs_or_is_missing_has_failed() -> None:
    assert "took over" in system.build(["/bin/sleep", "5"], 0.05)
    assert system.build(["/no/such/program"], 5.0)
    assert system.build(["/bin/true"], 5.0) == ""
    assert system.build(["/bin/sh", "-c", "echo why >&2; exit 3"], 5.0) == "why"


def test_a_release_is_tried_without_devices_network_and_rights(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[list[str]] = []

    def run(command: list[str], _: float) -> subprocess.CompletedProcess[str]:
        asked.append(command)
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setattr(system, "_run", run)
    system.as_daemon(["/x/mbot-agent", "try"], 120)
    options, command = asked[0][: asked[0].index("--")], asked[0][asked[0].index("--") + 1 :]
    assert command == ["/x/mbot-agent", "try"]
    for setting in ("User=mbot-agent", "RuntimeMaxSec=120", "PrivateDevices=yes"):
        assert f"--property={setting}" in options
    for setting in ("PrivateNetwork=yes", "ProtectSystem=strict", "NoNewPrivileges=yes"):
        assert f"--property={setting}" in options


def test_release_keys_come_from_the_configuration(tmp_path: Path) -> None:
    path = tmp_path / "config.toml"
    path.write_text(f'[trust]\nkeys = ["x"]\nrelease_keys = ["{KEY.public.line}"]\n')
    assert system.release_keys(path) == (KEY.public,)
    path.write_text('robot_id = "x"\n')
    assert system.release_keys(path) == ()
    for text in (
        "[trust",
        'trust = "x"',
        '[trust]\nrelease_keys = ["x"]',
        "[trust]\nrelease_keys=1",
    ):
        path.write_text(text)
        with pytest.raises(RefusedError):
            system.release_keys(path)


def test_a_daemon_that_changes_its_process_has_died(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = Robot(tmp_path, monkeypatch)
    robot.runs("0.1")
    from dataclasses import replace

    seen = iter([HEALTHY, replace(HEALTHY, pid=8)])
    monkeypatch.setattr(system, "service", lambda: next(seen))
    assert health_gate.is_worse(HEALTHY) == "it got READY and died"


def test_a_folder_without_its_mark_is_no_release(tmp_path: Path) -> None:
    folders = ReleaseFolders(tmp_path)
    folders.release("0.1").mkdir(parents=True)
    assert folders.versions() == []
    assert folders.current == ""
    with pytest.raises(RefusedError, match=r"no whole release 0\.1"):
        folders.switch("0.1")
    folders.finish("0.1")
    folders.switch("0.1")
    assert folders.current == "0.1"
    folders.sweep()
    assert folders.versions() == ["0.1"]
