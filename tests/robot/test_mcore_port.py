"""Why there is no board: each cause by its own name."""

import os
from pathlib import Path

import pytest
from serial.tools.list_ports_common import ListPortInfo

from mbot_agent.board.mcore import mcore_port
from mbot_agent.board.mcore.mcore_port import find_port
from mbot_agent.board.serial_port import open_port
from mbot_protocol.errors import UnreachableError


def plugged(monkeypatch: pytest.MonkeyPatch, folder: Path, *ids: str, ports: str = "") -> None:
    """A USB with these devices ("1a86:7523"), and serial ports ("/dev/ttyUSB0 0403:6001")."""
    for number, name in enumerate(ids):
        device = folder / f"1-{number}"
        device.mkdir()
        (device / "idVendor").write_text(name[:4] + "\n")
        (device / "idProduct").write_text(name[5:] + "\n")
    (folder / "1-0:1.0").mkdir()  # an interface
    found: list[ListPortInfo] = []
    if ports:
        path, name = ports.split()
        found.append(ListPortInfo(path))
        found[0].vid, found[0].pid = int(name[:4], 16), int(name[5:], 16)
    monkeypatch.setattr(mcore_port, "_USB_DEVICES", folder)
    monkeypatch.setattr(mcore_port.list_ports, "comports", lambda: found)


@pytest.mark.parametrize(
    ("ids", "ports", "said", "unsaid"),
    [
        ([], "", "plug it in", "brltty"),
        (["046d:0825"], "", "plug it in", "046d"),
        (["1a86:7523"], "", "brltty may have taken it", "plug it in"),
        (["1a86:5512"], "", "1a86:5512, of the same maker", "brltty"),
        (["1a86:5523", "1a86:7522"], "", "1a86:5523, 1a86:7522", "brltty"),
        (["1a86:7522"], "/dev/ttyUSB0 1a86:7522", r"/dev/ttyUSB0 \(1a86:7522\): if", "brltty"),
        (["0403:6001"], "/dev/ttyUSB3 0403:6001", "set board.port to it", "brltty"),
    ],
)
def test_why_no_board_is_found_is_told_by_what_is_there(
    ids: list[str],
    ports: str,
    said: str,
    unsaid: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    plugged(monkeypatch, tmp_path, *ids, ports=ports)
    with pytest.raises(UnreachableError, match=said) as caught:
        find_port("auto")
    assert unsaid not in str(caught.value)


def test_a_simulated_board_that_was_killed_is_gone_and_nobody_lacks_a_right(tmp_path: Path) -> None:
    """Its port is a link to a pseudo-terminal; root is told as everybody is."""
    master, slave = os.openpty()
    link = tmp_path / "board"
    link.symlink_to(os.ttyname(slave))
    os.close(slave)
    os.close(master)
    with pytest.raises(UnreachableError, match=rf"no board at {link} \(a link to /dev/pts/\d+, wh"):
        open_port(str(link), 115200)


def test_a_port_that_another_process_holds_is_called_so(tmp_path: Path) -> None:
    master, slave = os.openpty()
    with (
        open_port(os.ttyname(slave), 115200),
        pytest.raises(UnreachableError, match="in use by another process"),
    ):
        open_port(os.ttyname(slave), 115200)
    os.close(slave)
    os.close(master)
