"""What the updater asks of the system, in the system's words."""

import subprocess
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from mbot_protocol.errors import RefusedError
from mbot_update import health_gate, system
from mbot_update.release_folders import BEFORE_RELEASES, ReleaseFolders
from mbot_update.system import Service

from .release_bench import HEALTHY, KEY, Robot, saying

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
    seen = iter([HEALTHY, replace(HEALTHY, pid=8)])
    monkeypatch.setattr(system, "service", lambda: next(seen))
    assert health_gate.is_worse(HEALTHY) == "it got READY and died"


class Day:
    """A clock that only sleeping turns, and what systemd says at each time."""

    def __init__(
        self, robot: Robot, monkeypatch: pytest.MonkeyPatch, *later: tuple[float, Service]
    ) -> None:
        self.now_s = 1000.0
        self._later = later
        clock = SimpleNamespace(monotonic=lambda: self.now_s, sleep=self._sleep)
        monkeypatch.setattr(health_gate, "time", clock)
        monkeypatch.setattr(system, "service", self._service)
        monkeypatch.setattr(health_gate, "STAYS_S", 5.0)
        monkeypatch.setattr(health_gate, "HEALTHY_WITHIN_S", 30.0)
        robot.runs("0.1")

    def _sleep(self, time_s: float) -> None:
        self.now_s += time_s

    def _service(self) -> Service:
        found = HEALTHY
        for after_s, service in self._later:
            if self.now_s - 1000.0 >= after_s:
                found = service
        return found


BLIND = saying("idle; camera-lost")


@pytest.mark.parametrize(
    ("later", "why", "known_after_s"),
    [
        ([], "", 5.0),
        ([(0.0, BLIND), (12.0, HEALTHY)], "", 12.0),
        ([(0.0, BLIND)], "worse than before: camera-lost", 30.0),
        ([(0.0, saying(""))], "worse than before: it says nothing", 30.0),
        ([(4.0, replace(HEALTHY, pid=8))], "it got READY and died", 4.0),
        ([(0.0, BLIND), (20.0, replace(BLIND, state="failed"))], "it got READY and died", 20.0),
    ],
)
def test_a_new_release_has_its_time_to_find_board_and_camera(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    later: list[tuple[float, Service]],
    why: str,
    known_after_s: float,
) -> None:
    day = Day(Robot(tmp_path, monkeypatch), monkeypatch, *later)
    assert health_gate.is_worse(HEALTHY, "0.1") == why
    assert known_after_s <= day.now_s - 1000.0 < known_after_s + 2.0


def test_why_a_release_would_not_run_is_one_line_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = Robot(tmp_path, monkeypatch)
    for version in ("0.1", "0.2"):
        robot.has(version)

    def tried(stdout: str, stderr: str) -> str:
        def run(command: list[str], _: float) -> subprocess.CompletedProcess[str]:
            bad = "0.2" in command[0]
            return subprocess.CompletedProcess(command, 11 if bad else 0, stdout, stderr)

        monkeypatch.setattr(system, "as_daemon", run)
        return health_gate.would_not_run(robot.folders, "0.2", "0.1")

    assert tried("", "Traceback\n" + "x" * 1000 + "\n") == "x" * 300
    assert tried("one\ntwo\n", "") == "two"
    assert tried("", "") == "it ended with 11"


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


def test_one_of_before_releases_is_not_tried_for_it_knows_no_such_word(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = Robot(tmp_path, monkeypatch)
    robot.system.tried = {BEFORE_RELEASES: "invalid choice: 'try'"}
    assert health_gate.would_not_run(robot.folders, BEFORE_RELEASES, "0.1") == ""
