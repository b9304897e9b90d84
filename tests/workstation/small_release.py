"""A release with a daemon of one line and nothing that it needs."""

import zipfile
from pathlib import Path

import pytest

from mbot_workstation.fleet.models.signing_key import SigningKey
from mbot_workstation.fleet.releases import make_release
from mbot_workstation.fleet.releases.robot_wheels import Target


def small_release(
    folder: Path, monkeypatch: pytest.MonkeyPatch, target: Target, version: str
) -> Path:
    """The archive, in this folder."""
    (folder / "cache").mkdir()
    monkeypatch.setattr(make_release, "fetch_wheels", lambda *_: folder / "cache")
    wheel = folder / "mbot_agent-0.1.0-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w") as file:
        file.writestr(zipfile.ZipInfo("a.py"), "x = 1\n")
    key = SigningKey.ephemeral("releases")
    return make_release.make_release(target, wheel, version, 7, 7, [key], folder, folder, None)
