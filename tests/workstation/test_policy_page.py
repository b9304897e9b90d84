"""The script of docs/policy.md makes what a robot takes."""

import re
import subprocess
import sys
from pathlib import Path

from mbot_agent.models.dry_run import dry_run
from mbot_agent.models.policy import Policy
from mbot_workstation.models.check import check_model

PAGE = Path(__file__).parents[2] / "docs" / "policy.md"


def test_the_script_makes_a_policy_with_memory(tmp_path: Path) -> None:
    (script,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.S)
    subprocess.run([sys.executable, "-W", "ignore", "-c", script], cwd=tmp_path, check=True)
    path = tmp_path / "mine.onnx"
    assert check_model(path).metadata.contract_version == 2
    assert Policy.load(path).blank.state.shape == (1, 1, 32)
    assert dry_run(path.read_bytes(), rate_hz=2.5).inference_ms < 200
