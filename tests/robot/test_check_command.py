"""`mbot-agent check`, by whoever asks."""

import os
import socket
import subprocess
import sys
from pathlib import Path
from typing import NoReturn

import pytest

from mbot_agent import doctor
from mbot_agent import main as program
from mbot_agent.configuration import load
from mbot_agent.main import _check as check  # pyright: ignore[reportPrivateUsage]
from mbot_protocol.errors import ConfigurationError

from .fake_board import FakeBoard

DAEMONS_USER = "run it as the daemon's user: sudo -u mbot-agent mbot-agent check"


def answer(path: Path) -> str:
    """What `mbot-agent check` says of a configuration that it can't use."""
    with pytest.raises(ConfigurationError) as caught:
        check(path, as_json=False)
    return str(caught.value)


def test_who_may_not_read_the_configuration_is_told_who_may(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> NoReturn:
        raise PermissionError(13, "Permission denied")  # root may read all, and tests may be root

    monkeypatch.setattr("pwd.getpwuid", lambda _: type("User", (), {"pw_name": "rosa"}))
    monkeypatch.setattr(Path, "open", refuse)
    path = tmp_path / "config.toml"
    assert answer(path) == f"can't read {path} as rosa; {DAEMONS_USER} --config {path}"
    monkeypatch.setattr(program, "DEFAULT_PATH", str(path))
    assert answer(path) == f"can't read {path} as rosa; {DAEMONS_USER}"


def test_whatever_else_is_wrong_is_said_as_before(tmp_path: Path) -> None:
    assert answer(tmp_path / "none.toml").startswith("no configuration at")
    assert answer(tmp_path).endswith("Is a directory")


SUBJECTS = ["camera", "lens", "board", "trust", "model", "disk", "network", "brltty", "clock"]


def configured(folder: Path, more: str = "") -> Path:
    """A configuration of a robot that has nothing yet."""
    path = folder / "config.toml"
    lines = ['robot_id = "rosa"', "[board]", f'port = "{folder}/none"', "[models]"]
    path.write_text("\n".join([*lines, f'directory = "{folder}/models"', more]))
    return path


@pytest.mark.parametrize(
    "source",
    [
        "raise ValueError('numpy.dtype size changed')",
        "raise OSError('a shared library is missing')",
        "class Picamera2:\n    def global_camera_info():\n        raise RuntimeError('no manager')",
    ],
    ids=["another numpy", "no library", "no manager"],
)
def test_a_camera_library_that_raises_is_one_line_among_the_others(
    source: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "picamera2.py").write_text(source)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "picamera2", raising=False)
    assert check(configured(tmp_path), as_json=False) == 1
    said = capsys.readouterr().out.splitlines()
    assert [line.split()[1] for line in said] == SUBJECTS
    assert said[0].startswith("failed   camera ")


@pytest.mark.parametrize("error", [ZeroDivisionError("x"), OSError(5, "I/O"), KeyError("y")])
def test_whatever_a_check_raises_the_others_go_on(
    error: Exception, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object) -> NoReturn:
        raise error

    for name in ("frame_source", "PublicKey", "shutil", "examine_lens", "examine_trust"):
        monkeypatch.setattr(doctor, name, fails)
    found = doctor.examine(load(configured(tmp_path)), {})
    assert [finding.subject for finding in found] == SUBJECTS
    assert {finding.verdict for finding in found if finding.subject in ("camera", "lens")} == {
        "failed"
    }


def findings(path: Path) -> dict[str, doctor.Check]:
    return {finding.subject: finding for finding in doctor.examine(load(path), {})}


@pytest.mark.parametrize("prefix", ["", "ffmpeg:"])
@pytest.mark.parametrize(
    ("login", "is_told"), [("anna:ge@heim@", True), ("anna:ge%40heim@", False), ("", False)]
)
def test_a_password_with_an_at_sign_is_told_how_to_be_written(
    login: str, is_told: bool, prefix: str, tmp_path: Path
) -> None:
    address = f"{prefix}http://{login}127.0.0.1:1/one@two/@three"
    found = findings(configured(tmp_path, f'[camera]\nsource = "{address}"'))["camera"]
    assert (found.verdict, "%40" in found.detail) == ("failed", is_told)
    assert "heim" not in found.detail


@pytest.mark.parametrize(
    ("version", "verdict"), [("06.01.107", "warning"), ("0e.01.018", "failed")]
)
def test_another_board_of_the_same_maker_is_no_mcore(
    version: str, verdict: str, tmp_path: Path
) -> None:
    with FakeBoard(version) as board:
        path = tmp_path / "config.toml"
        settings = f'[board]\nport = "{board.path}"\naccept_no_deadman = true'
        path.write_text(f'robot_id = "rosa"\ncamera.source = "{tmp_path}/none"\n{settings}')
        found = findings(path)["board"]
    assert (found.verdict, "another board" in found.detail) == (verdict, verdict == "failed")


@pytest.mark.parametrize(
    ("told", "edge", "verdict"),
    [
        (0b11, "stop", "ok"),
        (0b110, "stop", "warning"),
        (0b10, "off", "ok"),
        (None, "stop", "warning"),
    ],
)
def test_the_board_says_what_it_feels(
    told: int | None, edge: str, verdict: str, tmp_path: Path
) -> None:
    version = "mbot-deadman 2 300ms" if told is None else "mbot-deadman 3 300ms"
    with FakeBoard(version) as board:
        board.felt = b"" if told is None else board.feeling(420, told)
        path = tmp_path / "config.toml"
        path.write_text(
            f'robot_id = "rosa"\ncamera.source = "{tmp_path}/none"\nboard.port = "{board.path}"\n'
            f'senses.edge = "{edge}"'
        )
        found = findings(path)["board"]
    assert found.verdict == verdict
    assert ("0.42 m" in found.detail) == (told is not None)


def test_a_port_that_is_taken_is_not_called_well(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        path = configured(tmp_path, f'[network]\nlisten = ["tcp/127.0.0.1:{port}"]')
        taken = findings(path)["network"]
        server.close()
        free = findings(path)["network"]
    assert (taken.verdict, free.verdict) == ("failed", "ok")
    assert f"port {port} is taken by" in taken.detail


def test_who_checks_before_the_first_start_leaves_nothing_behind(tmp_path: Path) -> None:
    """Made by `sudo mbot-agent check` the folder would be root's, and no use to the daemon."""
    path = configured(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    found = findings(path)
    assert sorted(tmp_path.rglob("*")) == before
    assert (found["model"].verdict, found["disk"].verdict) == ("warning", "ok")
    assert "none yet" in found["model"].detail


def test_a_folder_of_roots_is_not_the_daemons(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = configured(tmp_path)
    (tmp_path / "models").mkdir()
    assert findings(path)["disk"].verdict == "ok"
    status = Path.stat

    def stat(self: Path, *, follow_symlinks: bool = True) -> os.stat_result:
        found = list(status(self, follow_symlinks=follow_symlinks))
        found[4] = 0 if self.name == "models" else 987
        return os.stat_result(found)

    monkeypatch.setattr(Path, "stat", stat)
    assert (found := findings(path)["disk"]).verdict == "failed"
    assert "is root's" in found.detail


def test_a_reader_who_has_read_enough_is_no_error(tmp_path: Path) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-m", "mbot_agent.main", "check", "--config"]
    done = subprocess.run(
        [*command, str(configured(tmp_path))], stdout=writer, stderr=subprocess.PIPE, check=False
    )
    os.close(writer)
    assert (done.returncode, done.stderr) == (1, b"")
