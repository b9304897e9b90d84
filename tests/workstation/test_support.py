"""`workstation support`: what is in its file, and what never is."""

import json
import shutil
import tarfile
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.support import support
from mbot_workstation.fleet.enrolment.fleet_folder import FleetFolder
from mbot_workstation.fleet.enrolment.local_trial import LOOPBACK
from mbot_workstation.fleet.enrolment.membership import Enrolment
from mbot_workstation.fleet.models.key_folder import KeyFolder
from mbot_workstation.fleet.support.archive import FOLDER, of_configuration
from mbot_workstation.fleet.support.redaction import redacted, redacted_values

from .called import output_of
from .fake_robot import FakeRobot

CONFIG = """robot_id = "mbot-1"
# The password is tuna-1.
[camera]
source = "http://anna:tuna-3/?#@@10.0.0.9:8080/video?user=anna&pwd=tuna-4"
[board]
port = "/dev/no-such-board"
"""


def unpacked(path: Path) -> dict[str, str]:
    with tarfile.open(path) as tar:
        found: dict[str, str] = {}
        for entry in tar:
            file = tar.extractfile(entry)
            assert file is not None
            found[entry.name.removeprefix(f"{FOLDER}/")] = file.read().decode()
        return found


def test_it_holds_what_helps(robot: FakeRobot, tmp_path: Path) -> None:
    path = tmp_path / "s.tar.gz"
    said = output_of(support, "--robot", robot.address, "-o", path)
    assert "status.json" in said
    files = unpacked(path)
    assert json.loads(files["status.json"])["robot_id"] == robot.robot_id
    assert json.loads(files["models.json"])["models"][0]["active"]
    assert "numpy" in json.loads(files["versions.json"])["packages"]
    assert path.stat().st_mode & 0o077 == 0
    with pytest.raises(ConfigurationError, match="exists already"):
        output_of(support, "--robot", robot.address, "-o", path)


def test_faults_of_fetched_drives_are_in_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    recorded = Path(__file__).parents[1] / "data" / "recorded-drive"
    shutil.copytree(recorded, tmp_path / "drives" / "mbot-1" / "drive-0001")
    output_of(support, "--robot", "127.0.0.1:9", "-o", "s.tar.gz")
    assert json.loads(unpacked(Path("s.tar.gz"))["faults.json"]) == []


def test_without_a_robot_it_says_why_there_is_none(tmp_path: Path) -> None:
    output_of(support, "--robot", "127.0.0.1:9", "-o", tmp_path / "s.tar.gz")
    assert "nothing listens there" in unpacked(tmp_path / "s.tar.gz")["status.json"]


def test_no_secret_of_robot_or_workstation_gets_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "own"))
    KeyFolder().new("anna")
    configuration = tmp_path / "robot.toml"
    configuration.write_text(CONFIG)
    enrolment = Enrolment(FleetFolder())
    enrolment.robot("mbot-1", LOOPBACK)
    enrolment.place_beside(configuration, "mbot-1")
    output_of(support, "--robot", "mbot-1", "--config", configuration, "-o", tmp_path / "s.tar.gz")
    files = unpacked(tmp_path / "s.tar.gz")
    whole = "\n".join(files.values())
    assert "tuna" not in whole
    assert "10.0.0.9" in files["settings.toml"], "where the camera is may be seen"
    assert "camera" in files["check.txt"]
    secrets = [path.read_text() for path in tmp_path.rglob("*") if path.suffix in (".pem", ".key")]
    lines = [line for text in secrets for line in text.splitlines() if "-----" not in line]
    assert len(lines) > 20
    assert [line for line in lines if line in whole] == []


def test_what_is_no_toml_is_not_shown(tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text("source = http://anna:tuna@cam\n")
    assert "tuna" not in "".join(of_configuration(tmp_path / "robot.toml").values())


@pytest.mark.parametrize(
    "text",
    [
        "opens http://anna:tuna@cam/x",
        "ffmpeg:rtsp://anna:tu@tuna@cam/x, and goes on",
        "http://cam/x?token=tuna",
        "password = tuna tuna",
        "WIFI_PSK: psk=tuna",
        "-----BEGIN PRIVATE KEY-----\ntuna\n-----END PRIVATE KEY-----",
        "-----BEGIN PRIVATE KEY-----\ntuna\ncut off",
        "MBOT_TOKEN=tuna",
    ],
)
def test_what_looks_like_a_secret_is_hidden(text: str) -> None:
    assert "tuna" not in redacted(text)
    assert "tuna" not in json.dumps(redacted_values({"a": [text], "password": {"x": "tuna"}}))


@given(st.text(st.characters(exclude_characters="@"), min_size=1).map("tuna{}".format))
def test_no_password_in_an_address_survives(password: str) -> None:
    told = redacted_values({"source": f"http://anna:{password}@10.0.0.9/"})["source"]
    assert "tuna" not in told
    assert "10.0.0.9" in told
