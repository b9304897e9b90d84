"""How much of a Pi's card a release takes, from the very wheels that it would have there.

Needs neither root nor a booted machine, but the wheels, which are downloaded once.
"""

import compileall
from collections.abc import Callable
from pathlib import Path

import pytest

from mbot_update.python_packages import packages_of, unpack_wheels
from mbot_workstation.fleet.releases.make_release import build_wheel
from mbot_workstation.fleet.releases.robot_wheels import TARGETS, Target, fetch_wheels

from .booted import CHECKOUT
from .release_variants import CACHE

BAR_MB = 250
PIS = [target for target in TARGETS if target.architecture == "arm64"]


@pytest.mark.parametrize("target", PIS, ids=lambda target: target.name)
def test_a_release_takes_less_than_the_bar(
    target: Target, tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    (tmp_path / "venv/bin").mkdir(parents=True)
    (tmp_path / f"venv/lib/python{target.python}/site-packages").mkdir(parents=True)
    build_wheel(tmp_path / "own", epoch_s=1, sdist=False)
    for wheels in (fetch_wheels(target, CHECKOUT, CACHE), tmp_path / "own"):
        unpack_wheels(wheels, tmp_path / "venv")
    # With this Python; another one's bytecode is as long.
    compileall.compile_dir(packages_of(tmp_path / "venv"), maxlevels=20, quiet=2)
    size_mb = sum(p.stat().st_blocks * 512 for p in tmp_path.glob("venv/**/*")) / (1 << 20)
    record_property("disk MB", round(size_mb))
    assert size_mb < BAR_MB
