"""`mbot-agent check`, by whoever asks."""

from pathlib import Path
from typing import NoReturn

import pytest

from mbot_agent import main as program
from mbot_agent.main import _check as check  # pyright: ignore[reportPrivateUsage]
from mbot_protocol.errors import ConfigurationError

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
