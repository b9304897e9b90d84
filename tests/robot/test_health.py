from pathlib import Path

import pytest

from mbot_agent.network.health import SupplyAlarm, read_health


@pytest.fixture
def sensors(tmp_path: Path) -> Path:
    """As on a Raspberry Pi: the processor's temperature first."""
    for folder, name in (("hwmon0", "cpu_thermal"), ("hwmon1", "rpi_volt")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "name").write_text(f"{name}\n")
    (tmp_path / "hwmon1" / "in0_lcrit_alarm").write_text("0\n")
    return tmp_path


def test_a_machine_tells_its_health() -> None:
    health = read_health()
    assert health.resident_memory_bytes is not None
    assert health.resident_memory_bytes > 1_000_000


def test_a_supply_that_sags_is_told_and_asked_for_slowly(sensors: Path) -> None:
    alarm, flag = SupplyAlarm(sensors), sensors / "hwmon1" / "in0_lcrit_alarm"
    assert alarm.read(100.0) is False
    flag.write_text("1\n")
    assert alarm.read(100.0 + SupplyAlarm.EVERY_S / 2) is False, "not read yet"
    assert alarm.read(100.0 + SupplyAlarm.EVERY_S) is True
    flag.write_text("0\n")
    assert alarm.read(100.0 + 2 * SupplyAlarm.EVERY_S) is False


def test_where_there_is_no_such_sensor_nothing_is_told(sensors: Path, tmp_path: Path) -> None:
    assert SupplyAlarm(tmp_path / "none").read(0.0) is None
    alarm = SupplyAlarm(sensors)
    (sensors / "hwmon1" / "in0_lcrit_alarm").unlink()
    assert alarm.read(0.0) is None
    (sensors / "hwmon1" / "in0_lcrit_alarm").write_text("1\n")
    assert alarm.read(0.0 + SupplyAlarm.EVERY_S) is True, "the driver came later"
