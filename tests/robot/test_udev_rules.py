"""The udev rules parse, and match the board and nothing else."""

import re
from pathlib import Path

import pytest

DIRECTORY = Path(__file__).parents[2] / "deploy" / "udev"
FILES = sorted(DIRECTORY.glob("*.rules"))
BOARD = Path("60-mbot.rules")
BRLTTY = Path("95-mbot-brltty.rules")

PART = re.compile(
    r'(?P<key>[A-Z]+)(?:\{(?P<attribute>\w+)\})?(?P<operator>==|!=|\+=|:=|=)"(?P<value>[^"]*)"'
)
MATCHES = {"SUBSYSTEM", "KERNEL", "ATTR", "ATTRS"}
ASSIGNMENTS = {"GROUP", "MODE", "SYMLINK"}

Part = tuple[str, str, str, str]


def rules(path: Path) -> list[list[Part]]:
    """Each rule as (key, attribute, operator, value); an error where one is not understood."""
    parsed: list[list[Part]] = []
    for number, line in enumerate(path.read_text().splitlines(), 1):
        if not line or line.startswith("#"):
            continue
        parts: list[Part] = []
        for text in re.split(r",\s+", line):
            found = PART.fullmatch(text)
            assert found, f"{path.name}:{number}: {text!r} is not understood"
            key, attribute, operator, value = found.group("key", "attribute", "operator", "value")
            parts.append((key, attribute or "", operator, value))
        parsed.append(parts)
    return parsed


def assigned(path: Path) -> set[Part]:
    return {part for rule in rules(path) for part in rule if part[2] not in ("==", "!=")}


def test_both_files_are_there() -> None:
    assert [path.name for path in FILES] == [BOARD.name, BRLTTY.name]


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_operators_fit_their_keys(path: Path) -> None:
    """A single `=` where `==` is meant would assign to every device of the system."""
    for rule in rules(path):
        for key, _, operator, _ in rule:
            if key in MATCHES:
                assert operator in ("==", "!="), key
            elif key in ASSIGNMENTS:
                assert operator in ("=", "+=", ":="), key
            else:
                assert key == "ENV"


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_every_rule_is_for_the_ch340_only(path: Path) -> None:
    for rule in rules(path):
        ids = {attribute: value for key, attribute, _, value in rule if key.startswith("ATTR")}
        assert ids == {"idVendor": "1a86", "idProduct": "7523"}


def test_board_gets_a_stable_name_and_a_group() -> None:
    values = assigned(DIRECTORY / BOARD)
    assert ("SYMLINK", "", "+=", "mbot") in values
    assert ("GROUP", "", "=", "dialout") in values
    assert ("MODE", "", "=", "0660") in values


def test_modem_manager_keeps_off() -> None:
    assert ("ENV", "ID_MM_DEVICE_IGNORE", "=", "1") in assigned(DIRECTORY / BOARD)


def test_brltty_keeps_off_and_is_overruled_after_its_own_rules() -> None:
    assert ("ENV", "SYSTEMD_WANTS", "=", "") in assigned(DIRECTORY / BRLTTY)
    assert int(BRLTTY.name[:2]) > 90
