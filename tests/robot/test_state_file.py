"""What the daemon tells root's updater in a file, and what the updater makes of any file there."""

import json
import os
import subprocess
import threading
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_agent.process import state_file
from mbot_agent.process.state_file import StateFile
from mbot_protocol.daemon_state import FILE, LARGEST_BYTES, DaemonState
from mbot_update import foreign_files, system

from ..until import until

SHOWN = """ActiveState=active
MainPID=77
ExecMainStartTimestampMonotonic=5000
StatusText=running; camera-lost
Result=success
ExecMainStatus=0
"""
IN_WORDS = DaemonState(True, ("camera-lost",))
STANDS = DaemonState(False, ("board-lost",), 77, 6_000_000)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The daemon's runtime directory, as the updater looks for it."""
    found = tmp_path / "run"
    found.mkdir()
    monkeypatch.setattr(system, "STATE_DIRECTORY", found)
    done = subprocess.CompletedProcess([], 0, SHOWN, "")
    monkeypatch.setattr(system, "_run", lambda *_: done)
    return found


def test_each_change_is_told_by_another_thread_and_nothing_else_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written: list[tuple[str, DaemonState | None]] = []

    def replace(path: Path, data: bytes) -> None:
        assert path == tmp_path / FILE
        written.append((threading.current_thread().name, DaemonState.from_bytes(data)))

    monkeypatch.setattr(state_file.atomic_file, "replace", replace)
    began_ns = time.monotonic_ns()
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path))
    with StateFile() as file:
        for armed, faults in ((False, ("no-model",)), (False, ("no-model",)), (True, ())):
            file.tell(armed=armed, faults=faults)
    assert [name for name, _ in written] == ["state file"] * 2
    states = [state for _, state in written if state]
    assert [(one.armed, one.faults, one.pid) for one in states] == [
        (False, ("no-model",), os.getpid()),
        (True, (), os.getpid()),
    ]
    assert began_ns <= states[0].monotonic_ns <= states[1].monotonic_ns


def test_the_file_goes_with_the_daemon_and_what_no_longer_holds_does_not_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / FILE
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path))
    with StateFile() as file:
        file.tell(armed=False, faults=())
        assert until(path.exists)
        assert not list(tmp_path.glob("*.tmp"))

        def refuse(_path: Path, _data: bytes) -> None:
            raise OSError("no room")

        with monkeypatch.context() as patched:
            patched.setattr(state_file.atomic_file, "replace", refuse)
            file.tell(armed=True, faults=())
            assert until(lambda: not path.exists())
        file.tell(armed=False, faults=())
        assert until(path.exists)
    assert not path.exists()


def test_outside_systemd_nothing_is_written(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("RUNTIME_DIRECTORY", raising=False)
    with StateFile() as file:
        file.tell(armed=True, faults=())
        assert "state file" not in [one.name for one in threading.enumerate()]


def test_the_updater_believes_the_file_of_this_very_process(folder: Path) -> None:
    (folder / FILE).write_bytes(STANDS.to_bytes())
    found = system.service()
    assert (found.is_armed, found.faults) == (False, {"board-lost"})


@pytest.mark.parametrize(
    "content",
    [
        pytest.param(None, id="a daemon that writes none"),
        pytest.param(DaemonState(False, (), 78, 6_000_000).to_bytes(), id="another's"),
        pytest.param(DaemonState(False, (), 77, 4_999_999).to_bytes(), id="of before the start"),
        pytest.param(STANDS.to_bytes().replace(b'"schema": 1', b'"schema": 2'), id="newer"),
        pytest.param(STANDS.to_bytes() + b" " * LARGEST_BYTES, id="too large"),
        pytest.param(STANDS.to_bytes()[:-3], id="cut off"),
        pytest.param(b"[" * 4000, id="deep"),
    ],
)
def test_without_a_good_file_the_status_text_counts(folder: Path, content: bytes | None) -> None:
    if content is not None:
        (folder / FILE).write_bytes(content)
    assert system.service().report == IN_WORDS


def test_no_link_is_followed_and_nothing_is_waited_for(folder: Path, tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / FILE).write_bytes(STANDS.to_bytes())
    (folder / FILE).symlink_to(elsewhere / FILE)
    assert system.service().report == IN_WORDS
    (folder / FILE).unlink()
    os.mkfifo(folder / FILE)
    assert system.service().report == IN_WORDS
    (folder / FILE).unlink()
    folder.rmdir()
    folder.symlink_to(elsewhere)
    assert system.service().report == IN_WORDS
    with foreign_files.folder(elsewhere) as opened, foreign_files.plain(FILE, opened) as file:
        assert DaemonState.from_bytes(file.read()) == STANDS


def test_what_is_out_of_form_is_none() -> None:
    good = json.loads(STANDS.to_bytes())
    for change in (
        *({"armed": 0}, {"armed": None}, {"faults": [1]}, {"faults": 3}, {"pid": "77"}),
        *({"pid": True}, {"monotonic_ns": 0.5}, {"more": 1}, {"schema": "1"}),
    ):
        assert DaemonState.from_bytes(json.dumps(good | change).encode()) is None, change
    for name in good:
        less = {key: value for key, value in good.items() if key != name}
        found = DaemonState.from_bytes(json.dumps(less).encode())
        assert (found is None) == (name in ("schema", "armed", "faults")), name


@given(st.binary(max_size=200))
def test_garbage_is_no_state(data: bytes) -> None:
    assert DaemonState.from_bytes(data) is None


@given(st.booleans(), st.lists(st.text(max_size=20), max_size=5), st.integers(0, 2**31))
def test_a_state_is_read_back(armed: bool, faults: list[str], pid: int) -> None:
    state = DaemonState(armed, tuple(faults), pid, 5)
    assert DaemonState.from_bytes(state.to_bytes()) == state
