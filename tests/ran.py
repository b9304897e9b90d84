"""A program that runs to its end, and what came of it."""

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

WORKSTATION = (sys.executable, "-m", "mbot_workstation.main")

LIMIT_S = 100.0
"""On the busiest machine; a test of how long something takes says how long."""


def without_robot() -> dict[str, str]:
    """The environment of somebody who has named no robot, with a terminal that is wide enough."""
    clean = {name: value for name, value in os.environ.items() if not name.startswith("MBOT_")}
    return clean | {"TERM": "dumb", "COLUMNS": "200"}


def ran(
    *command: str | Path,
    env: Mapping[str, str] | None = None,
    cwd: Path | None = None,
    timeout: float = LIMIT_S,
) -> subprocess.CompletedProcess[str]:
    """Its exit code and what it wrote; there is nothing for it to read."""
    return subprocess.run(
        command,
        env=env,
        cwd=cwd,
        timeout=timeout,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
