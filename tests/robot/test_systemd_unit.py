"""The unit is one systemd accepts without a word, is locked down, and fits the other files.

Needs systemd's tools, not a running systemd: they check the files off line.
"""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from mbot_agent.configuration import DEFAULT_STATE_DIRECTORY
from mbot_protocol.daemon_state import DIRECTORY

from ..promised import promised
from ..ran import ran

DEPLOY = Path(__file__).parents[2] / "deploy"
UNIT = DEPLOY / "systemd" / "mbot-agent.service"
MODULES = DEPLOY / "modules-load.d" / "mbot-agent.conf"
SYSUSERS = DEPLOY / "sysusers.d" / "mbot-agent.conf"


def systemd_tool(name: str) -> str:
    path = shutil.which(name)
    if path is None:
        pytest.fail(f"{name} is missing: apt-get install systemd")
    return path


def settings(key: str) -> list[str]:
    """Every value of a key, in order."""
    return re.findall(rf"^{key}=(.*)$", UNIT.read_text(), re.MULTILINE)


def words(key: str) -> list[str]:
    return " ".join(settings(key)).split()


def entries(path: Path) -> list[str]:
    lines = path.read_text().splitlines()
    return [line for line in lines if line and not line.startswith("#")]


def test_systemd_accepts_every_line(tmp_path: Path) -> None:
    program = tmp_path / "mbot-agent"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    unit = tmp_path / UNIT.name
    unit.write_text(
        UNIT.read_text().replace("/opt/mbot-agent/current/venv/bin/mbot-agent", str(program))
    )

    # Mistakes are printed, yet the exit status stays 0.
    result = ran(systemd_tool("systemd-analyze"), "verify", "--man=no", unit)

    assert result.stdout + result.stderr == ""
    assert result.returncode == 0


def test_verify_would_notice_a_mistake(tmp_path: Path) -> None:
    unit = tmp_path / UNIT.name
    unit.write_text(UNIT.read_text().replace("WatchdogSec=", "WatchDogSecs="))
    result = ran(systemd_tool("systemd-analyze"), "verify", "--man=no", unit)
    assert "WatchDogSecs" in result.stdout + result.stderr


def test_exposure_is_low() -> None:
    exposure = promised("unit-exposure")  # a unit with nothing but User= has 9.2
    result = ran(
        systemd_tool("systemd-analyze"),
        "security",
        "--offline=true",
        f"--threshold={exposure * 10:.0f}",
        UNIT,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    told = re.search(r"Overall exposure level for .*: ([\d.]+)", result.stdout)
    assert told is not None
    assert float(told[1]) <= exposure


@pytest.mark.parametrize(
    "key",
    [
        "ProcSubset",  # =pid hides /proc/cpuinfo from onnxruntime
        "PrivateUsers",  # the groups dialout and video would be nobody's
        "PrivateDevices",  # hides camera and board
        "LimitMEMLOCK",  # =0 makes zenoh.open fail
        "PrivateNetwork",
    ],
)
def test_settings_that_break_the_daemon_are_absent(key: str) -> None:
    assert settings(key) == []


def test_a_hung_or_dead_daemon_is_replaced_and_the_motors_are_stopped() -> None:
    assert settings("Type") == ["notify"]
    assert settings("NotifyAccess") == ["main"]
    assert settings("Restart") == ["always"]
    assert float(settings("WatchdogSec")[0]) + float(settings("RestartSec")[0]) <= 7
    assert settings("ExecStopPost") == [
        "-/opt/mbot-agent/current/venv/bin/mbot-agent stop-motors",
        "-+/usr/bin/python3 -I -B /opt/mbot-agent/updater ended",
    ]


def test_the_updater_looks_where_systemd_lets_the_daemon_write() -> None:
    assert settings("RuntimeDirectory") == [DIRECTORY.name]
    assert DIRECTORY.parent == Path("/run")
    assert settings("RuntimeDirectoryMode") == ["0700"]


def test_start_limit_leaves_room_for_a_rollback_and_stands_in_the_unit_section() -> None:
    unit_section = UNIT.read_text().partition("[Service]")[0]
    assert "StartLimitIntervalSec=" in unit_section
    assert int(settings("StartLimitBurst")[0]) > 3


def test_libraries_are_told_to_be_quiet_and_single_threaded() -> None:
    assert {"ORT_DISABLE_TELEMETRY=1", "OPENBLAS_NUM_THREADS=1"} <= set(words("Environment"))


def test_allowed_serial_drivers_are_loaded_before() -> None:
    driver_module = {"char-ttyUSB": "usbserial", "char-ttyACM": "cdc_acm"}
    allowed = {value.split()[0] for value in settings("DeviceAllow")}
    serial = {name for name in allowed if name.startswith("char-tty")}
    assert serial == set(driver_module)
    assert {driver_module[name] for name in serial} <= set(entries(MODULES))


def test_netlink_is_open_for_libcamera() -> None:
    assert "AF_NETLINK" in words("RestrictAddressFamilies")


def test_state_directory_is_the_one_the_daemon_expects() -> None:
    assert Path("/var/lib") / settings("StateDirectory")[0] == DEFAULT_STATE_DIRECTORY


def test_the_user_exists_and_has_the_groups_of_the_service(tmp_path: Path) -> None:
    """`sudo -u mbot-agent mbot-agent check` must see what the service sees."""
    etc = tmp_path / "etc"
    etc.mkdir()
    (etc / "passwd").write_text("root:x:0:0:root:/root:/bin/sh\n")
    (etc / "group").write_text("root:x:0:\ndialout:x:20:\nvideo:x:44:\n")
    command = [systemd_tool("systemd-sysusers"), f"--root={tmp_path}", str(SYSUSERS)]

    for _ in range(2):  # an update runs it again
        subprocess.run(command, check=True, capture_output=True)

    users = [line.split(":") for line in (etc / "passwd").read_text().splitlines()]
    user = next(fields for fields in users if fields[0] == settings("User")[0])
    assert 0 < int(user[2]) < 1000
    assert user[6].endswith("nologin")
    members = dict(line.split(":")[::3] for line in (etc / "group").read_text().splitlines())
    for group in words("SupplementaryGroups"):
        assert members[group] == user[0]


def test_the_updaters_units_are_faultless_and_make_no_cycle(tmp_path: Path) -> None:
    """All of them together, as at boot; systemd would drop one of a cycle without an error."""
    for unit in UNIT.parent.glob("mbot-agent*"):
        text = unit.read_text()
        for program in ("/opt/mbot-agent/current/venv/bin/mbot-agent", "/usr/bin/python3"):
            text = text.replace(program, "/bin/true")
        (tmp_path / unit.name).write_text(text)
    units = sorted(tmp_path.iterdir())
    assert len(units) == 5
    (tmp_path / "all.target").write_text(
        "[Unit]\nWants=multi-user.target " + " ".join(unit.name for unit in units) + "\n"
    )
    result = ran(
        systemd_tool("systemd-analyze"), "verify", "--man=no", "all.target", *units, cwd=tmp_path
    )
    told = [line for line in (result.stdout + result.stderr).splitlines() if "mbot-agent" in line]
    assert told == []


def test_the_lines_that_open_the_pins_to_the_service_are_accepted(tmp_path: Path) -> None:
    page = (DEPLOY.parent / "docs" / "other-robots.md").read_text()
    (lines,) = re.findall(r"```ini\n(.*?)```", page, re.DOTALL)
    added = tmp_path / f"{UNIT.name}.d" / "override.conf"
    added.parent.mkdir()
    added.write_text(lines)
    (tmp_path / UNIT.name).write_text(re.sub("=[-+]*/opt/\\S+", "=/bin/true", UNIT.read_text()))
    result = ran(systemd_tool("systemd-analyze"), "verify", "--man=no", tmp_path / UNIT.name)
    assert result.stdout + result.stderr == ""
    added.write_text(lines.replace("DeviceAllow", "DeviceAlow"))
    result = ran(systemd_tool("systemd-analyze"), "verify", "--man=no", tmp_path / UNIT.name)
    assert "DeviceAlow" in result.stderr
