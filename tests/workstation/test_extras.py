"""Without an extra everything else works, and its commands say which one is missing."""

import subprocess
import sys
from pathlib import Path

import pytest

from ..ran import ran

SOURCE = Path(__file__).parents[2] / "workstation" / "mbot_workstation"
OTHERS = [
    ".".join(("mbot_workstation", *path.relative_to(SOURCE).with_suffix("").parts))
    for path in sorted(SOURCE.rglob("*.py"))
    if path.relative_to(SOURCE).parts[0] != "measure"
]


def run(missing: str, code: str) -> subprocess.CompletedProcess[str]:
    blocked = f"import sys; sys.modules['{missing}'] = None; "
    return ran(sys.executable, "-c", blocked + code)


def test_all_but_measuring_works_without_its_libraries() -> None:
    done = run("scipy", f"import importlib\nfor name in {OTHERS}: importlib.import_module(name)")
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("missing", "extra", "words"),
    [("scipy", "measure", ("identify", "folder")), ("torch", "train", ("train",))],
)
def test_a_command_names_the_extra_that_is_missing(
    missing: str, extra: str, words: tuple[str, ...]
) -> None:
    argv = ["workstation", *words]
    done = run(missing, f"sys.argv = {argv}; from mbot_workstation.main import main; main()")
    assert (done.returncode, len(done.stderr.splitlines())) == (1, 1)
    assert missing in done.stderr
    assert f"'.[{extra}]'" in done.stderr
